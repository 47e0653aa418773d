"""Kinetostatic singularity monitor for planar serial arms with revolute joints."""
