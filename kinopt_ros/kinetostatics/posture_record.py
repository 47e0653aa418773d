"""The optimal posture as one plain record for programs: what the service and --json give."""


def optimal_posture_record(joint_names, posture, to_joint_positions=list):
    """
    Put an optimal posture into a dictionary of names, numbers and lists, ready for JSON.

    Parameters
    ----------
    joint_names : sequence of str, length n
    posture : OptimalPosture
    to_joint_positions : callable, optional
        Gives the joint positions in rad that a controller would command for the n joint angles
        theta_1 ... theta_n in rad of the model; by default the same.

    Returns
    -------
    record : dict
        With the keys joint_names, joint_positions (rad), link_lengths (m), z,
        characteristic_length (m), margin, isotropic and alternatives, a list of
        {joint_positions, z}.
    """
    def positions(joint_angles):
        return [float(position) for position in to_joint_positions(joint_angles)]

    return {
        'joint_names': list(joint_names),
        'joint_positions': positions(posture.joint_angles),
        'link_lengths': list(posture.link_lengths),
        'z': posture.z,
        'characteristic_length': posture.characteristic_length,
        'margin': posture.margin,
        'isotropic': posture.isotropic,
        'alternatives': [{'joint_positions': positions(alternative.joint_angles),
                          'z': alternative.z} for alternative in posture.alternatives],
    }
