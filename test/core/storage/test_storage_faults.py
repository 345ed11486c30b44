"""The repertoire file with killed writers, foreign files, full disks and missing permissions."""

from __future__ import annotations

import contextlib
import resource
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from pga_me_ros.core.storage.database import explained
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.errors import StorageError
from repertoires import (
    ENVIRONMENT,
    INFO,
    RATES,
    empty,
    generations,
    make,
    writer_in_a_transaction,
)

READ = """
import sys
from repertoires import give_up_root
from pga_me_ros.core.storage.repertoire import Repertoire
give_up_root()
try:
    with Repertoire.open(sys.argv[1], read_only=True) as repertoire:
        print(repertoire.result_digest())
except ValueError as error:
    print(error)
"""
CREATE = """
import sys
from repertoires import INFO, empty, give_up_root
from pga_me_ros.core.storage.repertoire import Repertoire
archive = empty()
give_up_root()
try:
    Repertoire.create(sys.argv[1], INFO, archive)
except ValueError as error:
    print(error)
"""
START = """
import sys
from pathlib import Path
from repertoires import give_up_root
from pga_me_ros.core.runs.run_directory import open_run
from pga_me_ros.core.settings import Settings
from pga_me_ros.tasks.registry import task_spec
spec = task_spec("qd_walker")
give_up_root()
try:
    open_run(Path(sys.argv[1]), spec, Settings(cells=16, cvt_samples=500))
except ValueError as error:
    print(error)
"""
FILL = """
import resource
import sys
from repertoires import INFO, RATES, empty, generations
from pga_me_ros.core.storage.repertoire import Repertoire
repertoire = Repertoire.open(sys.argv[1])
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
try:
    repertoire.commit(*list(generations(empty(), 3))[2], RATES)
except ValueError as error:
    print(error)
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "repertoire.db"


@pytest.fixture
def open_folder() -> Iterator[Path]:
    """Return a folder that other users can access, unlike pytest's own."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    yield folder
    folder.chmod(0o755)
    shutil.rmtree(folder)


def run(code: str, path: Path) -> str:
    """Run code in another process with a path as its argument; return what it prints."""
    return subprocess.run(
        [sys.executable, "-c", code, str(path)],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()


@pytest.mark.parametrize("read_only", [True, False])
def test_kill_9_in_a_transaction_leaves_the_last_generation(path: Path, read_only: bool) -> None:
    with writer_in_a_transaction(path):
        pass
    archive = empty()
    list(generations(archive, 4))
    with Repertoire.open(path, read_only=read_only) as repertoire:
        assert repertoire.result_digest() == archive.digest()


def test_reading_next_to_a_writer_gives_the_last_generation(path: Path) -> None:
    archive = empty()
    list(generations(archive, 4))
    with writer_in_a_transaction(path), Repertoire.open(path, read_only=True) as repertoire:
        assert repertoire.result_digest() == archive.digest()


def test_the_error_for_a_second_writer_names_the_first(path: Path) -> None:
    with (
        writer_in_a_transaction(path) as process,
        pytest.raises(StorageError, match=f"written by another process .pid {process.pid} on "),
    ):
        Repertoire.open(path)


def test_a_dead_writer_does_not_keep_others_out(path: Path) -> None:
    with writer_in_a_transaction(path):
        pass
    with Repertoire.open(path) as repertoire:
        assert not repertoire.read_only


def _digest(path: Path) -> str:
    with Repertoire.open(path, read_only=True) as repertoire:
        return repertoire.result_digest()


def _foreign_database(path: Path) -> None:
    with contextlib.closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("CREATE TABLE elites (cell INTEGER)")


def _other_version(path: Path) -> None:
    make(path)
    with contextlib.closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("PRAGMA user_version = 99")


@pytest.mark.parametrize("read_only", [True, False])
@pytest.mark.parametrize(
    ("prepare", "message"),
    [
        (lambda path: None, "There is no repertoire"),
        (Path.mkdir, "is not a file"),
        (lambda path: path.write_text("hello"), "not a repertoire"),
        (lambda path: path.write_bytes(b"\x80\x04cos\nsystem\n."), "not a repertoire"),
        (_foreign_database, "SQLite database, but not a repertoire"),
        (_other_version, "schema version 99, but this program reads 1"),
    ],
)
def test_anything_but_a_repertoire_of_this_version_is_refused(
    path: Path, prepare: Callable[[Path], object], message: str, read_only: bool
) -> None:
    prepare(path)
    with pytest.raises(StorageError, match=message):
        Repertoire.open(path, read_only=read_only)


def test_an_existing_file_is_not_overwritten(path: Path) -> None:
    archive = make(path)
    with pytest.raises(StorageError, match="exists already"):
        Repertoire.create(path, INFO, empty())
    assert _digest(path) == archive.digest()


def test_a_stale_log_is_not_applied_to_a_new_file(path: Path) -> None:
    Path(f"{path}-wal").write_bytes(b"left behind")
    with pytest.raises(StorageError, match="exists already"):
        Repertoire.create(path, INFO, empty())


def test_a_folder_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run").write_text("")
    with pytest.raises(StorageError, match=r"(Not a directory|File exists)"):
        Repertoire.create(tmp_path / "run" / "repertoire.db", INFO, empty())


def test_a_read_only_folder_is_refused(open_folder: Path) -> None:
    open_folder.chmod(0o555)
    answer = run(CREATE, open_folder / "repertoire.db")
    assert "choose a folder that can be written to" in answer


@pytest.mark.parametrize("name", ["", "new"])
def test_a_read_only_run_directory_is_refused(open_folder: Path, name: str) -> None:
    open_folder.chmod(0o555)
    answer = run(START, open_folder / name)
    assert f"folder '{open_folder}" in answer
    assert "choose" in answer
    assert "run_dir" not in answer, "not every caller has such an option"
    assert not list(open_folder.iterdir())


def test_a_file_in_a_read_only_folder_can_be_read(open_folder: Path) -> None:
    path = open_folder / "repertoire.db"
    archive = make(path)
    open_folder.chmod(0o555)
    assert run(READ, path) == archive.digest()


def test_a_killed_writers_file_in_a_read_only_folder_can_be_read(open_folder: Path) -> None:
    path = open_folder / "repertoire.db"
    with writer_in_a_transaction(path):
        pass
    archive = empty()
    list(generations(archive, 4))
    open_folder.chmod(0o555)
    assert run(READ, path) == archive.digest()


def test_generations_in_an_unusable_log_are_not_ignored(open_folder: Path) -> None:
    path = open_folder / "repertoire.db"
    with writer_in_a_transaction(path):
        pass
    Path(f"{path}-shm").unlink()
    open_folder.chmod(0o555)
    assert "cannot be opened or written" in run(READ, path)


def test_a_commit_without_space_is_explained(path: Path) -> None:
    make(path, 2)
    assert "What was committed is safe" in run(FILL, path)


def test_a_commit_without_space_leaves_the_generation_before(path: Path) -> None:
    archive = make(path, 2)
    run(FILL, path)
    assert _digest(path) == archive.digest()


def test_a_failed_commit_can_be_repeated(path: Path) -> None:
    with Repertoire.create(path, INFO, empty()) as repertoire:
        first, *_ = generations(empty(), 1)
        limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
        try:
            with pytest.raises(StorageError):
                repertoire.commit(*first, RATES)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert repertoire.commit(*first, RATES)


def test_a_database_locked_from_outside_is_explained(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pga_me_ros.core.storage.database.BUSY_SECONDS", 0.05)
    make(path, 0)
    with (
        Repertoire.open(path) as repertoire,
        contextlib.closing(sqlite3.connect(path, isolation_level=None)) as other,
    ):
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(StorageError, match="another program keeps it locked"):
            repertoire.commit(*next(generations(empty(), 1)), RATES)


def test_a_mount_without_file_locks_is_not_reported_as_damage(tmp_path: Path) -> None:
    error = sqlite3.OperationalError("locking protocol")
    error.sqlite_errorname = "SQLITE_PROTOCOL"
    with (
        pytest.raises(StorageError, match="does not support the file locks") as told,
        explained(tmp_path / "repertoire.db"),
    ):
        raise error
    assert "copy it" in str(told.value)
    assert "Restore" not in str(told.value)
