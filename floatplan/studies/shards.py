"""Shards: equal shares of a study's rows, planned by runs that share nothing but its files, and put into one table."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from floatplan.errors import InputError
from floatplan.studies.driver import Progress, started
from floatplan.studies.file import StudyFile
from floatplan.studies.folder import ADVICE, STUDY, Range, StudyFolder, written
from floatplan.studies.rows import row_check
from floatplan.studies.study import Study, asked, facts, filled, finished

FOLDER = "shards"  # of a study's folder, with a folder for each
MOST_NAMED = 8  # shards, in a message


@dataclass(frozen=True)
class Shard:
    """The ``number``-th, from 1, of ``count`` shares of a study's rows that follow each other."""

    number: int
    count: int

    def __str__(self) -> str:
        """As it is asked for."""
        return f"{self.number}/{self.count}"

    def rows(self, total: int) -> Range:
        """The first of its rows, and the one after its last, of so many."""
        return total * (self.number - 1) // self.count, total * self.number // self.count

    @classmethod
    def asked(cls, words: str, total: int) -> "Shard":
        """Read "3/64" about a study of so many rows, each shard of which has one at least."""
        found = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", words)
        if not found:
            raise InputError(f"must be a number and how many there are, such as 3/64, not {words!r}", element="shard")
        shard = cls(int(found[1]), int(found[2]))
        if not 1 <= shard.count <= total:
            raise InputError(f"{shard}: the study's {total} rows make 1 to {total} shards", element="shard")
        if not 1 <= shard.number <= shard.count:
            raise InputError(f"{shard}: they are numbered from 1 to {shard.count}", element="shard")
        return shard


def plan_shard(
    path: str | Path,
    shard: str,
    *,
    folder: str | Path | None,
    restart: bool,
    progress: Callable[[Progress], None],
    **engine: Any,
) -> Study:
    """Plan the rows of a shard that its folder lacks, and return these; the arguments are as of :func:`study`.

    Raises
    ------
    InputError
        There is no such shard; or as of :func:`study`.
    """
    file = asked(Path(path))
    which = Shard.asked(shard, len(file))
    place = StudyFolder(
        Path(folder or file.folder) / FOLDER / f"{which.number}-of-{which.count}", which.rows(len(file))
    )
    with place.locked():
        place.open(file.digest(), {**facts(file), "shard": [which.number, which.count]}, restart)
        filled(file, place, started(**engine), progress)
        done = Study(file, place, place.table())
        done.files = [place.path]
        return done


def merged(path: str | Path, folder: str | Path | None, parts: Sequence[Path]) -> Study:
    """Put the rows of all shards into a study's folder, its table and its maps.

    ``parts`` are their folders, all that the study's has where there are none.

    Raises
    ------
    InputError
        A folder has no shard, or one of another study; shards are missing, twice there, of unlike numbers, or not done.
    """
    file = asked(Path(path))
    place = StudyFolder(Path(folder or file.folder), (0, len(file)))
    parts = parts or sorted(each for each in (place.path / FOLDER).glob("*") if each.is_dir())
    tables = [_rows(file, part, shard) for shard, part in _complete(file, place, parts)]
    with place.locked():
        place.open(file.digest(), facts(file), restart=False)
        place.discard_chunks()
        first = 0
        for table in tables:
            place.keep(first, first + len(table), written(table))
            first += len(table)
        return finished(file, place)


def _complete(file: StudyFile, place: StudyFolder, parts: Sequence[Path]) -> list[tuple[Shard, Path]]:
    """All shards of a study in their order, with their folders."""
    advice = 'run "floatplan study STUDY.toml --shard 1/4", then 2/4, ..'
    found: dict[int, tuple[Shard, Path]] = {}
    count = 0
    for part in parts:
        shard = _shard(file, part)
        count = count or shard.count
        if shard.count != count:
            raise InputError(
                f"is shard {shard}, beside others of {count}", source=part, advice="merge those of one cut"
            )
        if shard.number in found:
            raise InputError(
                f"is shard {shard}, as {found[shard.number][1]} is", source=part, advice="give one of them"
            )
        found[shard.number] = shard, part
    missing = [str(number) for number in range(1, (count or 1) + 1) if number not in found]
    if missing:
        named = ", ".join(missing[:MOST_NAMED]) + (", .." if len(missing) > MOST_NAMED else "")
        reason = f"{len(missing)} of {count} shards are missing: {named}" if count else "there are no shards"
        raise InputError(reason, source=place.path, advice=advice)
    return [found[number] for number in sorted(found)]


def _shard(file: StudyFile, part: Path) -> Shard:
    """Which shard of this study a folder has."""
    record = StudyFolder(part, (0, 0)).record()
    if record is None:
        raise InputError(f"has no {STUDY}", source=part, advice="give folders of shards")
    if record.get("hash") != file.digest():
        raise InputError("holds a shard of another study, problem, robot, code or solver", source=part, advice=ADVICE)
    match record.get("shard"):
        case [int(number), int(count)] if 1 <= number <= count <= len(file):
            return Shard(number, count)
    raise InputError("holds no shard", source=part, advice="give folders of shards")


def _rows(file: StudyFile, part: Path, shard: Shard) -> Any:
    """The table of a shard whose rows are all there."""
    place = StudyFolder(part, shard.rows(len(file)))
    with place.locked():
        left = sum(stop - first for first, stop in place.missing(row_check(file)))
        if left:
            raise InputError(
                f"{left} rows are still to be planned", source=part, advice=f"run --shard {shard} again, which goes on"
            )
        return place.table()
