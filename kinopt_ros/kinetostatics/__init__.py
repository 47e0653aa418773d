"""The paper in NumPy: planar arms, their index and what follows from it; nothing of ROS."""

from kinopt_ros.kinetostatics.gradient import index_gradient, IndexGradient
from kinopt_ros.kinetostatics.index import kinetostatic_index, KinetostaticIndex
from kinopt_ros.kinetostatics.model_set import closest_model_set, index_against
from kinopt_ros.kinetostatics.optimal_posture import optimal_posture, OptimalPosture
from kinopt_ros.kinetostatics.planar_arm import PlanarArm

__all__ = [
    'IndexGradient', 'KinetostaticIndex', 'OptimalPosture', 'PlanarArm', 'closest_model_set',
    'index_against', 'index_gradient', 'kinetostatic_index', 'optimal_posture']
