"""An MJCF file with all that it includes, as one element, and the content of its meshes: MuJoCo itself opens no file.

Left out is what a robot in flight does not have, and what makes MuJoCo's compiler simulate or allocate: sensors,
pictures, terrain, sizes and buffers, options of its solvers, ranges of lengths. Elements by which a short file makes
thousands of bodies, or calls code, are refused.
"""

from dataclasses import dataclass, field
from pathlib import Path, PurePath
from xml.etree.ElementTree import Element, SubElement

from floatplan.errors import InputError
from floatplan.files import LARGEST_URDF, check_depth, parsed_xml, read_regular
from floatplan.robot.shapes.collisions import LARGEST_MESH

MOST_FILES = 200  # [-] included files, and meshes
LARGEST_TOTAL = 500_000_000  # [bytes] of all of them, which are in memory at once
SAVED = "load the file in MuJoCo and save it with mj_saveLastXML, which writes out what they make"
REFUSED = {  # elements: why, and what to do about it
    **dict.fromkeys(("replicate", "composite"), ("makes many bodies out of one", SAVED)),
    **dict.fromkeys(("attach", "model"), ("is another model inside this one", SAVED)),
    **dict.fromkeys(("flexcomp", "flex"), ("is a body that bends, and only rigid ones can be planned", "remove it")),
    **dict.fromkeys(("plugin", "extension"), ("calls code that is not in the file", "remove it")),
}


@dataclass(frozen=True, eq=False)
class MjcfText:
    """A ``<mujoco>`` element without includes, of the file at ``path``.

    ``files`` are contents by paths from its folder: of included files and meshes; ``meshes`` the paths of mesh assets;
    ``askers`` the included files of the elements that name a further file.
    """

    root: Element
    path: Path
    files: dict[str, bytes] = field(default_factory=dict)
    meshes: dict[str, str] = field(default_factory=dict)
    askers: dict[Element, Path] = field(default_factory=dict)

    def refused(self, reason: str, element: Element, advice: str | None = None) -> InputError:
        """The refusal of an element, which names its file."""
        source = self.askers.get(element, self.path)
        return InputError(reason, source=source, element=_element_name(element), advice=advice)


def whole_mjcf(root: Element, path: Path) -> MjcfText:
    """Return the whole of the MJCF file at ``path``, whose own element is ``root``.

    Raises
    ------
    InputError
        It includes a file that does not exist, lies outside its folder or was included already; a mesh does not exist
        or has no file; there are too many elements; or one of them is not read.
    """
    text = MjcfText(root, path)
    while (pair := _first_include(root)) is not None:
        parent, include = pair
        index = list(parent).index(include)
        parent[index : index + 1] = list(_included(text, include))
        _check_size(root)
    _check_size(root)
    check_depth(root, Element)
    left_out = (
        "size",
        "visual",
        "statistic",
        "custom",
        "sensor",
        "texture",
        "material",
        "hfield",
        "skin",
        "lengthrange",
    )
    # Of actuators, buffers of any size, and of meshes, trees of any size.
    left_out_attributes = ("material", "nsample", "delay", "interp", "actdim", "octree_maxdepth")
    for element in root.iter():
        if element.tag in REFUSED:
            reason, advice = REFUSED[element.tag]
            raise InputError(f"{reason}; it is not read", element=_element_name(element), advice=advice)
        for name in left_out_attributes:
            element.attrib.pop(name, None)
        for child in list(element):
            if child.tag in left_out or (child.tag, child.get("type")) == ("geom", "hfield"):
                element.remove(child)
    for option in root.findall("option"):
        _keep_surroundings(option)
    # Else MuJoCo would simulate each muscle for the range of its length.
    SubElement(SubElement(root, "compiler"), "lengthrange", mode="none")
    _read_meshes(text)
    return text


def _keep_surroundings(option: Element) -> None:
    """Leave of an ``<option>`` the robot's surroundings: compiling ends with a step of simulation, by any solver."""
    flags = [flag.get("gravity") for flag in option.findall("flag") if flag.get("gravity") is not None]
    attributes: dict[str, str] = {}
    for name in ("gravity", "density", "viscosity", "wind"):
        if name in option.attrib:
            attributes[name] = option.attrib[name]
    option.clear()
    option.attrib.update(attributes)
    for flag in flags:
        SubElement(option, "flag", gravity=str(flag))


def _first_include(root: Element) -> tuple[Element, Element] | None:
    """An ``<include>`` and its parent; None where there is none any more."""
    for parent in root.iter():
        for child in parent:
            if child.tag == "include":
                return parent, child
    return None


def _check_size(root: Element) -> None:
    for tag, most in (("*", 20_000), ("body", 1000)):  # many times those of any robot
        count = sum(1 for _ in root.iter(tag))
        if count > most:
            raise InputError(f"has {count} elements, more than the {most} that can be handled", element=f"<{tag}>")


def _element_name(element: Element) -> str:
    name = element.get("name") or element.get("file")
    return f'<{element.tag}> "{name}"' if name else f"<{element.tag}>"


def _included(text: MjcfText, include: Element) -> Element:
    """The root element of the file that an ``<include>`` names."""
    folder = text.path.parent.resolve()
    written = include.get("file", "").strip()
    if not written:
        raise text.refused("names no file", include, 'write one: <include file=".."/>, or remove the element')
    target = (folder / written).resolve()
    if not target.is_relative_to(folder):
        reason = "lies outside the folder of the file that includes it"
        advice = "put it into that folder"
        raise text.refused(reason, include, advice)
    name = target.relative_to(folder).as_posix()
    if name in text.files or target == text.path.resolve():
        raise text.refused("is included twice, or includes itself", include, "remove one of the elements")
    root = parsed_xml(_content(text, name, LARGEST_URDF, include), text.path.parent / name)
    if root.tag not in ("mujoco", "mujocoinclude"):
        raise InputError(f"is not an MJCF: its root element is <{root.tag}>", source=text.path.parent / name)
    for tag in ("include", "mesh"):
        text.askers.update(dict.fromkeys(root.iter(tag), text.path.parent / name))
    return root


def _content(text: MjcfText, name: str, largest: int, element: Element) -> bytes:
    """Content of a file, which ``text`` then contains."""
    if len(text.files) >= MOST_FILES:
        raise InputError(f"is read with more than {MOST_FILES} other files, as no robot is")
    try:
        text.files[name] = read_regular(text.path.parent / name, largest, "an included file of an MJCF")
    except InputError as error:
        reason = error.reason if element.tag == "include" else f"{name}: {error.reason}"
        by = "" if element.tag == "include" else ", and of the <compiler>'s meshdir or assetdir"
        advice = error.advice or f"its path is from the folder of {text.path.name}{by}"
        raise text.refused(reason, element, advice) from None
    if sum(map(len, text.files.values())) > LARGEST_TOTAL:
        raise InputError(f"is read with more than {LARGEST_TOTAL // 1_000_000} MB of other files, as no robot is")
    return text.files[name]


def _read_meshes(text: MjcfText) -> None:
    """Read the files of the mesh assets, whose elements then have a name, and the path from the MJCF's folder."""
    compiler: dict[str, str] = {}
    for element in text.root.findall("compiler"):
        for key in ("meshdir", "assetdir", "texturedir", "strippath"):  # where files are
            if key in element.attrib:
                compiler[key] = element.attrib.pop(key)
    folder = compiler.get("meshdir", compiler.get("assetdir", ""))
    for mesh in text.root.iterfind("asset/mesh"):
        if not mesh.get("file") or mesh.get("refpos") or mesh.get("refquat"):
            reason = "is written here or moved by refpos or refquat, and only meshes of files, as they are, can be read"
            raise text.refused(reason, mesh, "write the mesh to a file, and name that")
        written = PurePath(mesh.get("file", ""))
        path = PurePath(folder) / (written.name if compiler.get("strippath") == "true" else written)
        name = path.as_posix()
        if name not in text.files:
            _content(text, name, LARGEST_MESH, mesh)
        mesh.set("file", name)
        mesh.set("name", mesh.get("name") or written.stem)
        text.meshes[mesh.get("name", "")] = name
