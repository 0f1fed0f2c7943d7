"""Shards of a study, planned by runs that share nothing but its file, are put into one table."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from floatplan.errors import InputError
from floatplan.studies.driver import started
from floatplan.studies.file import StudyFile, load_study_file
from floatplan.studies.folder import SHARDS, Shard, StudyFolder, written
from floatplan.studies.rows import row_check
from floatplan.studies.study import Study, facts, planned_study

FOREIGN = "holds no shard of this study; file, problem, robot, code and solver have to be the same"


def merged(path: Path, folder: Path | None, parts: Sequence[Path]) -> Study:
    """Put the rows of all shards into a study's folder, with its table and its maps.

    ``parts`` are their folders; those in the study's own where there are none.

    Raises
    ------
    InputError
        A folder has no shard of this study; shards are missing, there twice, of unlike numbers, or not done.
    """
    file = load_study_file(path)
    place = StudyFolder(folder or file.folder, (0, len(file)))
    parts = parts or sorted(each for each in (place.path / SHARDS).glob("*") if each.is_dir())
    found: dict[Shard, Path] = {}
    for part in parts:
        shard = Shard(0, 0)
        match StudyFolder(part, (0, 0)).record():
            case {"hash": digest, "shard": [int(number), int(count)]} if digest == file.digest():
                shard = Shard(number, count)
        if not 1 <= shard.number <= shard.count <= len(file):
            raise InputError(FOREIGN, source=part)
        if shard in found:
            raise InputError(f"is shard {shard}, as {found[shard]} is", source=part, advice="give one of them")
        found[shard] = part
    count = max((shard.count for shard in found), default=1)
    wanted = [Shard(number, count) for number in range(1, count + 1)]
    missing = [str(shard) for shard in wanted if shard not in found]
    if missing:
        reason, advice = f"shards are missing: {', '.join(missing)}", f"floatplan study STUDY.toml --shard {missing[0]}"
        raise InputError(reason, source=place.path / SHARDS, advice=advice)
    tables = [_rows(file, shard, found[shard]) for shard in wanted]
    with place.locked():
        place.open(file.digest(), facts(file), restart=False)
        place.open(file.digest(), facts(file), restart=True)  # what is there of the same study goes
        for shard, table in zip(wanted, tables, strict=True):
            place.keep(*shard.rows(len(file)), written(table))
    return planned_study(path, folder, False, started("processes", 1, None), None)


def _rows(file: StudyFile, shard: Shard, part: Path) -> Any:
    """The table of a shard whose rows are all there."""
    place = StudyFolder(part, shard.rows(len(file)))
    with place.locked():
        left = sum(stop - first for first, stop in place.missing(row_check(file)))
        if left:
            raise InputError(f"lacks {left} rows of shard {shard}", source=part, advice="plan it again, which goes on")
        return place.table()
