"""A URDF written anew where what is read of it differs from what it says: base, balanced inertias, payload."""

from copy import deepcopy
from xml.etree.ElementTree import Element, SubElement

from floatplan.robot.urdf.tree import Inertial, UrdfTree


def urdf_of(tree: UrdfTree, read: UrdfTree, root: Element) -> Element:
    """Return the ``<robot>`` element of a tree.

    Parameters
    ----------
    tree : the robot as it is taken
    read : the robot as its file has it
    root : that file's element; returned itself where nothing differs
    """
    links = {name for name, link in tree.links.items() if link is not read.links[name]}
    joints = {joint.name for joint in tree.joints if joint is not read.joint[joint.name]}
    if not links and not joints:
        return root
    written = deepcopy(root)
    for element in written:
        name = element.get("name", "")
        if element.tag == "link" and name in links:
            link = tree.links[name]
            if link.frame:
                element.set("type", "frame")
            if link.inertial is not read.links[name].inertial and link.inertial is not None:
                _write_inertial(element, link.inertial)
        if element.tag == "joint" and name in joints:
            element.set("type", "fixed")
            for inner in list(element):
                if inner.tag not in ("parent", "child", "origin"):
                    element.remove(inner)
    return written


def _write_inertial(link: Element, inertial: Inertial) -> None:
    for old in link.findall("inertial"):
        link.remove(old)
    element = SubElement(link, "inertial")
    xyz, rpy = (" ".join(map(repr, values.tolist())) for values in (inertial.origin.xyz, inertial.origin.rpy))
    SubElement(element, "origin", xyz=xyz, rpy=rpy)
    SubElement(element, "mass", value=repr(float(inertial.mass)))
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = inertial.inertia.tolist()
    moments = {"ixx": xx, "ixy": xy, "ixz": xz, "iyy": yy, "iyz": yz, "izz": zz}
    SubElement(element, "inertia", {name: repr(value) for name, value in moments.items()})
