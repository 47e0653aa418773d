"""Pictures of arms, their index and their isotropic sets, drawn with matplotlib."""
