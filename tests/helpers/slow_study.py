"""A study in small chunks, in a process that is killed in the middle: after some chunks it waits for that."""

import signal
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Event
from typing import Any

import floatplan as fp
from floatplan.pool import start_server
from floatplan.studies import driver
from floatplan.studies.study import planned_study

ROWS = 4  # of a chunk


def run(path: str, folder: str, last: int, shard: str, progress_of: Connection) -> None:
    """Run a study in this process, or a shard of it, until there are so many chunks, and send how many there are."""
    driver.FIRST_CHUNK = driver.MOST_IN_CHUNK = ROWS

    def wait(progress: driver.Progress) -> None:
        progress_of.send(progress.done // ROWS)
        if progress.done >= last * ROWS:
            Event().wait()

    if shard:
        planned_study(Path(path), Path(folder), False, driver.started("processes", 1, None), wait, shard)
    else:
        fp.study(path, folder=folder, jobs=1, progress=wait)


def timeless(table: Any) -> Any:
    """A study's table without what each row took."""
    return table.drop_columns(["milliseconds"])


def killed_after(chunks: int, path: Path, folder: Path, more: int = 0, shard: str = "") -> None:
    """Run it in a process of its own, killed once there are so many chunks, and while it may make so many more."""
    context = start_server("floatplan.studies.study")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=run, args=(str(path), str(folder), chunks + more, shard, theirs))
    process.start()
    theirs.close()
    while ours.recv() < chunks:
        continue
    process.kill()
    process.join()
    assert process.exitcode == -signal.SIGKILL
