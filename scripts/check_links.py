"""Checks that every link of the pages in a folder leads to a page of it, and every anchor to a place there."""

from __future__ import annotations

import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """A page's links and the names of its places."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.places: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect what leads somewhere, and what can be led to."""
        for name, value in attrs:
            if value and ((tag in ("a", "link") and name == "href") or (tag in ("img", "script") and name == "src")):
                self.links.append(value)
            elif value and name == "id":
                self.places.add(value)


@cache
def target_of(folder: Path, link: str) -> Path:
    """Return where a link from a page in a folder leads: pages of one folder have hundreds of links in common."""
    return (folder / unquote(link)).resolve()


def broken_links(folder: Path) -> list[str]:
    """Return sentences, one for each link within the folder that leads nowhere."""
    pages = {path.resolve(): Page(path) for path in sorted(folder.rglob("*.html"))}
    broken = []
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = target_of(path.parent, parts.path) if parts.path else path
            if not target.is_file():
                broken.append(f"{path.relative_to(folder.resolve())}: {link} leads nowhere")
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].places:
                broken.append(f"{path.relative_to(folder.resolve())}: {link} has no such place")
    return broken


def main() -> None:
    """Exit with code 1 where a link leads nowhere."""
    broken = broken_links(Path(sys.argv[1]))
    for sentence in broken:
        print(sentence, file=sys.stderr)
    raise SystemExit(bool(broken))


if __name__ == "__main__":
    main()
