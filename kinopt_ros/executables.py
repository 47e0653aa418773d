"""
What `ros2 run` starts: the nodes of this package as processes.

The imports are made only after the signals have their meaning: they take most of the start,
and a process that is told to end in the middle of them has to end as cleanly as later.
"""

from kinopt_ros.monitor import signals


def singularity_monitor():
    """Watch an arm."""
    signals.end_at_once()
    from kinopt_ros.monitor.singularity_monitor import main
    return main()


def simulated_arm():
    """Publish the joint states of an arm that moves."""
    signals.end_at_once()
    from kinopt_ros.tools.simulated_arm import main
    return main()
