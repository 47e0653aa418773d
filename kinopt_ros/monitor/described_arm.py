"""An arm that is given as two links of a robot description instead of by its link lengths."""

from dataclasses import dataclass
import math

from kinopt_ros.monitor.robot_description import planar_subchain_of


@dataclass(frozen=True)
class DescribedArm:
    """
    Where in a robot description the arm is.

    Attributes
    ----------
    base_link, tip_link : str
    joint_names : tuple of str or None
        Exactly the joints of the arm; None for the longest run of parallel axes.
    tool_offset : tuple of float, shape (3,)
        Operation point in the frame of tip_link, in m.
    held_positions : dict of str to float
        Positions of joints that are held still, in rad or m.
    """

    base_link: str
    tip_link: str
    joint_names: tuple
    tool_offset: tuple
    held_positions: dict

    @classmethod
    def from_parameters(cls, values, joint_names):
        """
        Judge the parameters that point into a robot description.

        Parameters
        ----------
        values : dict of str to value
            By the names of the parameters; None where a parameter has no value.
        joint_names : sequence of str or None

        Returns
        -------
        arm : DescribedArm or None
            None if neither link is given.

        Raises
        ------
        ValueError
            If a rule is broken: names the parameter, its value and the rule.
        """
        base_link, tip_link = values['base_link'], values['tip_link']
        if not base_link and not tip_link:
            return None
        for name, value, other in (('base_link', base_link, tip_link),
                                   ('tip_link', tip_link, base_link)):
            if not value:
                raise ValueError(f"parameter {name} = '': must be given together with '{other}'")
        offset = tuple(values['tool_offset'])
        if len(offset) != 3 or not all(map(math.isfinite, offset)):
            raise ValueError(f'parameter tool_offset = {list(offset)}: must hold three finite '
                             'values')
        held, positions = values['held_joints'] or (), values['held_positions'] or ()
        if len(held) != len(positions):
            raise ValueError(f'parameter held_positions = {list(positions)}: must hold one value '
                             f'per held joint {list(held)}')
        if len(set(held)) != len(held):
            raise ValueError(f'parameter held_joints = {list(held)}: must not name a joint twice')
        return cls(base_link, tip_link, joint_names and tuple(joint_names), offset,
                   dict(zip(held, positions)))

    def subchain(self, description):
        """
        Find the arm in a description.

        Parameters
        ----------
        description : str
            URDF document.

        Returns
        -------
        subchain : PlanarSubchain

        Raises
        ------
        ValueError
            If it cannot be read or holds no such arm, or if no parser is installed.
        """
        try:
            return planar_subchain_of(
                description, self.base_link, self.tip_link, self.joint_names, self.tool_offset,
                self.held_positions)
        except ImportError as error:
            raise ValueError(str(error)) from error


def arm_parameters(subchain):
    """Values of the arm's parameters that follow from a planar sub-chain."""
    return {
        'joint_names': list(subchain.joint_names),
        'link_lengths': list(subchain.link_lengths),
        'joint_offsets': list(subchain.joint_offsets),
        'joint_directions': list(subchain.joint_directions),
        'joint_lower': list(subchain.joint_lower),
        'joint_upper': list(subchain.joint_upper),
    }
