"""ROS parameter files, read without a node."""

from fnmatch import fnmatchcase
from pathlib import Path

import yaml


def parameters_of_file(path, node_name):
    """
    Parameters that a ROS parameter file gives a node, in whatever namespace.

    Parameters
    ----------
    path : path-like
    node_name : str

    Returns
    -------
    values : dict of str to value

    Raises
    ------
    ValueError
        If it is no ROS parameter file, or nothing in it concerns the node.
    """
    values = {}
    try:
        for node, entry in _nodes(yaml.safe_load(Path(path).read_text(encoding='utf-8'))):
            if fnmatchcase(node_name, node.split('/')[-1]) and isinstance(entry, dict):
                values.update(entry)
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f'{path}: not a ROS parameter file: {error}') from error
    if not values:
        raise ValueError(f'{path}: holds no parameters for {node_name}')
    return values


def _nodes(content, prefix=''):
    """Names of nodes and their parameters; namespaces may be nested."""
    if not isinstance(content, dict):
        return
    for name, entry in content.items():
        if name == 'ros__parameters':
            yield prefix, entry
        else:
            yield from _nodes(entry, f'{prefix}/{name}')
