"""The paper in NumPy: planar arms, their index and what follows from it; nothing of ROS."""

from kinopt_ros.kinetostatics.index import kinetostatic_index, KinetostaticIndex
from kinopt_ros.kinetostatics.model_set import closest_model_set
from kinopt_ros.kinetostatics.planar_arm import PlanarArm

__all__ = ['KinetostaticIndex', 'PlanarArm', 'closest_model_set', 'kinetostatic_index']
