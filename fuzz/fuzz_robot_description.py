"""
Coverage-guided fuzzing of the reader of robot descriptions.

    pip install atheris
    python3 fuzz/fuzz_robot_description.py -max_total_time=180 [CORPUS FOLDER]

The arguments are libFuzzer's. Whatever the bytes: a planar arm or a ValueError, soon.
"""

from pathlib import Path
import sys

import atheris

with atheris.instrument_imports(include=['kinopt_ros', 'urdf_parser_py']):
    from kinopt_ros.kinetostatics.planar_arm import PlanarArm
    from kinopt_ros.monitor.described_arm import arm_parameters
    from kinopt_ros.monitor.robot_description import planar_subchain_of

FIXTURES = Path(__file__).parent.parent / 'test' / 'fixtures'
LINKS = [('base_link', 'tool0'), ('base_link', 'tip'), ('world', 'base_link')]
TEMPLATE = """<robot name="r"><link name="base_link"/><link name="a"/><link name="b"/>
<link name="c"/><link name="tip"/>{}</robot>"""
JOINT = ('<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
         '<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{more}</joint>')


def made_up(data):
    """A description that is mostly sound, so that the fuzzer gets past the parser."""
    names = ['base_link', 'a', 'b', 'c', 'tip']
    joints = []
    for parent, child in zip(names, names[1:]):
        joints.append(JOINT.format(
            name=f'to_{child}', parent=parent, child=child,
            kind=data.PickValueInList(
                ['revolute', 'continuous', 'fixed', 'prismatic', 'floating', 'planar', 'x']),
            xyz=triple(data), rpy=triple(data), axis=triple(data),
            more=data.PickValueInList(
                ['', '<limit lower="-1" upper="1" effort="1" velocity="1"/>',
                 '<limit lower="nan" upper="inf"/>', '<mimic joint="to_a"/>'])))
    return TEMPLATE.format(''.join(joints))


def triple(data):
    """Three numbers, or what stands in their place."""
    if data.ConsumeIntInRange(0, 15) == 0:
        return data.ConsumeUnicodeNoSurrogates(12).replace('<', '').replace('"', '')
    return ' '.join(str(data.PickValueInList([0.0, 0.0, 1.0, -1.0, 0.5, 1e300, 1e-300])
                        if data.ConsumeBool() else data.ConsumeFloat()) for _ in range(3))


def read(content):
    """Give a description to the reader, and what it finds to the monitor."""
    data = atheris.FuzzedDataProvider(content)
    if data.ConsumeBool():
        description, links = made_up(data), ('base_link', 'tip')
    else:
        links = data.PickValueInList(LINKS)
        description = data.ConsumeUnicode(data.remaining_bytes())
    try:
        subchain = planar_subchain_of(description, *links)
        PlanarArm(arm_parameters(subchain)['link_lengths'])
    except ValueError:
        return


def main():
    """Fuzz from the descriptions of the tests on."""
    atheris.Setup([*sys.argv, str(FIXTURES)], read)
    atheris.Fuzz()


if __name__ == '__main__':
    main()
