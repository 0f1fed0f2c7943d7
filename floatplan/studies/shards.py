"""Merges the shards of a study, planned by runs that share nothing but its file, into one table."""

import os
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from floatplan.errors import InputError
from floatplan.studies.driver import started
from floatplan.studies.file import StudyFile, load_study_file
from floatplan.studies.folder import Range, ResultFile, Shard, StudyFolder, listed, written
from floatplan.studies.rows import row_check
from floatplan.studies.study import Study, facts, planned_study


def merged(path: Path, folder: Path | None, parts: Sequence[Path]) -> Study:
    """Put the rows of all shards into a study's folder, with its table and its maps.

    ``parts`` are the shards' folders; those in the study's own where there are none.

    Raises
    ------
    InputError
        A folder has no shard of this study; shards are missing, there twice, of different numbers, or not done.
    """
    file = load_study_file(path)
    own = StudyFolder(folder or file.folder, (0, len(file)))
    folders_of_shards = parts or [path for path in listed(own.path / ResultFile.SHARDS) if path.is_dir()]
    folders: dict[Shard, Path] = {}
    for folder_of_shard in folders_of_shards:
        shard = Shard(0, 0)
        match StudyFolder(folder_of_shard, (0, 0)).record():
            case {"hash": digest, "shard": [int(number), int(count)]} if digest == file.digest():
                shard = Shard(number, count)
        if not 1 <= shard.number <= shard.count <= len(file):
            reason = "holds no shard of this study; file, problem, robot, code and solver have to be the same"
            raise InputError(reason, source=folder_of_shard)
        if shard in folders:
            reason = f"is shard {shard}, as {folders[shard]} is"
            raise InputError(reason, source=folder_of_shard, advice="give one of them")
        folders[shard] = folder_of_shard
    count = max((shard.count for shard in folders), default=1)
    shards = [Shard(number, count) for number in range(1, count + 1)]
    missing = [str(shard) for shard in shards if shard not in folders]
    if missing:
        reason = f"shards are missing: {', '.join(missing)}"
        advice = f"floatplan study STUDY.toml --shard {missing[0]}"
        raise InputError(reason, source=own.path / ResultFile.SHARDS, advice=advice)
    tables = [_rows(file, shard, folders[shard]) for shard in shards]
    with own.locked():
        own.open(file.digest(), facts(file), restart=False)
        contents = own.contents(row_check(file))
        if contents.damaged:
            advice = f"floatplan study {path} plans its rows again; or give another folder"
            raise InputError("is damaged", source=contents.damaged[0], advice=advice)
        for shard, table in zip(shards, tables, strict=True):
            _save_missing(own, contents.gaps, shard.rows(len(file)), table)
    return planned_study(path, folder, False, started("processes", 1, None), None)


def _save_missing(folder: StudyFolder, gaps: Sequence[Range], rows: Range, table: Any) -> None:
    """Write the rows of a shard's table that the study's folder lacks; all others stay."""
    for first, stop in gaps:
        first = max(first, rows[0])
        stop = min(stop, rows[1])
        if first < stop:
            folder.save(first, stop, written(table.slice(first - rows[0], stop - first)))


def _rows(file: StudyFile, shard: Shard, folder_of_shard: Path) -> Any:
    """The table of a shard whose rows are all done; its folder is read, and nothing in it is removed."""
    own = StudyFolder(folder_of_shard, shard.rows(len(file)))
    is_writable = os.access(folder_of_shard, os.W_OK)  # else no run can be at work there, and a lock cannot be written
    with own.locked() if is_writable else nullcontext():
        contents = own.contents(row_check(file))
        left = sum(stop - first for first, stop in contents.gaps)
        if left:
            advice = "plan it again, which goes on"
            if contents.damaged:
                advice = f"{contents.damaged[0].name} is damaged; {advice}"
            raise InputError(f"lacks {left} rows of shard {shard}", source=folder_of_shard, advice=advice)
        return own.table(contents.chunks)
