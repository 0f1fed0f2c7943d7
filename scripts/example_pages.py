"""Writes the pages of the site that show the examples, from the scripts' own words and what they printed and drew.

``scripts/example_pages.py run`` first runs the examples, all or those that are named, and keeps their pictures in
``docs/images/examples/`` and what they print beside the pages: minutes. That needs all extras.
"""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES, PAGES = ROOT / "examples", ROOT / "docs" / "examples"
PICTURES = ROOT / "docs" / "images" / "examples"
SHOWN = {  # the pages' order
    "A flight": (
        "first_flip",
        "first_flight",
        "handstand",
        "own_robot",
        "obstacle",
        "weak_motors",
        "falling_cat",
        "space_arm",
    ),
    "Many flights": ("sweep", "study", "library"),
    "Is it true?": ("certificate", "mujoco_playback", "in_flight"),
    "From standing to standing": ("jump", "fly_a_go2"),
    "With others": ("from_mjcf", "pinocchio_interop", "ros_trajectory", "reference_motion", "repair_a_clip"),
    "How it works": ("bounds_by_hand", "the_method"),
}
DRAWN_ELSEWHERE = {
    "first_flip": "../images/flights.png",
    "handstand": "../images/handstand.png",
    "the_method": "../images/obstacle.png",
}
WIDE = 950  # [pixels] of a picture that has a row of its own
INTRODUCTION = (
    "Short scripts with one idea each, in `examples/`. They read `problems/` and `urdf/`, run from any folder,"
    " and write into `runs/` or the folder that they are given: `.venv/bin/python examples/first_flight.py somewhere`."
)


@dataclass(frozen=True)
class Example:
    """A title and what is said of it, paragraph by paragraph, and its code, as Markdown."""

    name: str
    title: str
    text: tuple[str, ...]
    code: str

    @property
    def pictures(self) -> list[str]:
        """Paths of its pictures, from the folder of the pages; the first is the one that stands for it."""
        own = [path for pattern in ("", "_*") for path in sorted(PICTURES.glob(f"{self.name}{pattern}.png"))]
        return [f"../images/examples/{path.name}" for path in own] or [DRAWN_ELSEWHERE[self.name]]

    @property
    def page(self) -> str:
        """The page, as Markdown."""
        narrow = [path for path in self.pictures if width_of(path) < WIDE]
        beside = "49%" if len(narrow) > 1 else "60%"
        drawn = [picture(path, self.title, beside if path in narrow else "100%") for path in self.pictures]
        printed = f"{self.name}.txt"
        if (PAGES / printed).exists():
            drawn.append(f"```{{literalinclude}} {printed}\n:language: text\n:caption: It prints\n```")
        return blocks(f"# {self.title}", *self.text, *drawn, self.code)

    @property
    def entry(self) -> str:
        """Its row of the list of all."""
        shown = picture(self.pictures[0], self.title, "100%", f"{self.name}.html").replace("\n", "\n    ")
        return f"* - {shown}\n  - **[{self.title}]({self.name}.md)**\n\n    {self.text[0]}"


def width_of(path: str) -> int:
    """Width of a picture in PNG, as its head says."""
    return int.from_bytes((PAGES / path).read_bytes()[16:20])


def picture(path: str, alt: str, width: str, target: str = "") -> str:
    """An image of the page, as Markdown."""
    leads = f":target: {target}\n" if target else ""
    return f"```{{image}} {path}\n:alt: {alt}\n:width: {width}\n{leads}```"


def blocks(*parts: str) -> str:
    """Markdown of several blocks."""
    return "\n\n".join(parts) + "\n"


def script(path: Path) -> Example:
    """A script: its docstring begins with the title, which ends at a colon or as a question, and says what it is."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    told = re.fullmatch(r"(?s)([^:?]+)([:?])\s+(.+)", ast.get_docstring(tree) or "")
    if told is None:
        raise SystemExit(f"{path.name}: its docstring must begin with a title, as 'A first flight: a gymnast jumps ..'")
    title, mark, rest = told.groups()
    code = f"```{{literalinclude}} ../../examples/{path.name}\n:lines: {(tree.body[0].end_lineno or 0) + 2}-\n```"
    text = tuple(" ".join(each.split()) for each in (rest[0].upper() + rest[1:]).split("\n\n"))
    return Example(path.stem, title + mark.strip(":"), text, code)


def notebook(path: Path) -> Example:
    """A notebook, as it was when it was written."""
    (first, *others) = json.loads(path.read_text(encoding="utf-8"))["cells"]
    title, text = "".join(first["source"]).removeprefix("# ").split("\n", 1)
    parts = []
    for cell in others:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python3\n{source}\n```")
        for output in cell["outputs"]:
            said = "".join(output.get("text") or output["data"]["text/plain"])
            parts.append(f"```text\n{said.rstrip()}\n```")
    return Example(path.stem, title, (text.strip(),), "\n\n".join(parts))


def examples() -> dict[str, list[Example]]:
    """All of them, by the headings that they stand under."""
    read = {".py": script, ".ipynb": notebook}
    paths = {path.stem: path for path in EXAMPLES.iterdir() if path.suffix in read}
    return {heading: [read[paths[name].suffix](paths[name]) for name in names] for heading, names in SHOWN.items()}


def pages() -> dict[str, str]:
    """The content of all pages, by their file's name."""
    found = examples()
    rows = {heading: "\n".join(each.entry for each in group) for heading, group in found.items()}
    tables = [f"## {heading}\n\n````{{list-table}}\n:widths: 40 60\n\n{text}\n````" for heading, text in rows.items()]
    names = "\n".join(each.name for group in found.values() for each in group)
    index = blocks("# Examples", INTRODUCTION, *tables, f"```{{toctree}}\n:hidden:\n\n{names}\n```")
    return {"index.md": index} | {f"{each.name}.md": each.page for group in found.values() for each in group}


def run(names: Iterable[str]) -> None:
    """Run scripts, each in a folder of its own, and keep what they print and draw."""
    from make_images import save
    from PIL import Image

    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, str(EXAMPLES / f"{name}.py"), "out"]
            printed = subprocess.run(command, cwd=folder, check=True, stdout=subprocess.PIPE, text=True).stdout
            (PAGES / f"{name}.txt").write_text(printed, encoding="utf-8")
            for old in (PICTURES / f"{name}.png", *PICTURES.glob(f"{name}_*.png")):
                old.unlink(missing_ok=True)
            for drawn in sorted(Path(folder, "out").glob("*.png")):
                save(Image.open(drawn).convert("RGB"), PICTURES / drawn.name)


def main() -> None:
    if sys.argv[1:2] == ["run"]:
        run(sys.argv[2:] or sorted(path.stem for path in EXAMPLES.glob("*.py")))
    for name, content in pages().items():
        (PAGES / name).write_text(content, encoding="utf-8")


if __name__ == "__main__":
    main()
