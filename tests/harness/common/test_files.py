import errno
import os
from pathlib import Path

import pandas as pd
import pytest

from harness.common.errors import InputError
from harness.common.files import (
    is_temporary,
    replacing,
    save_figure,
    temporary_of,
    write_results,
    write_text,
    write_toml,
)
from harness.storage.grid_folder import write_row
from harness.storage.manifest import RunFacts, write_manifest
from harness.storage.tables import write_table


class Half:
    """A figure whose saving finds no room half-way."""

    def savefig(self, path: Path, **options: object) -> None:
        path.write_text("half")
        raise OSError(errno.ENOSPC, "No space left on device")


@pytest.fixture
def full_disk(monkeypatch):
    """Let every text and table be cut short by a full disk."""

    def cut_short(path: Path, text: str, **options: object) -> None:
        path.write_bytes(text.encode()[:3])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_text", cut_short)
    monkeypatch.setattr("pyarrow.parquet.write_table", lambda table, file, **options: Half().savefig(Path(file.name)))


WRITERS = {
    "text": lambda path: write_text(path, "a long text"),
    "table": lambda path: write_table(pd.DataFrame({"a": [1]}), path),
    "figure": lambda path: save_figure(Half(), path),
    "manifest": lambda path: write_manifest(path, RunFacts("complete", "run", 0, 1)),
    "toml": lambda path: write_toml(path, {"a": 1}, "b"),
}


@pytest.mark.parametrize("writer", WRITERS)
def test_a_full_disk_leaves_an_earlier_file_as_it_was_and_nothing_half_written(writer, full_disk, tmp_path):
    path = tmp_path / "file.png"
    path.write_bytes(b"earlier")
    with pytest.raises(OSError, match="No space"):
        WRITERS[writer](path)
    assert path.read_bytes() == b"earlier"
    path.unlink()
    with pytest.raises(OSError, match="No space"):
        WRITERS[writer](path)
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_no_half_row_and_no_half_result(full_disk, tmp_path):
    with pytest.raises(OSError, match="No space"):
        write_row(tmp_path, "key", {"succeeded": True})
    with pytest.raises(OSError, match="No space"):
        write_results(tmp_path, {}, "text")
    assert list(tmp_path.iterdir()) == []


def test_a_process_that_ends_half_way_leaves_a_name_that_is_known_as_such(tmp_path):
    with replacing(tmp_path / "row.json") as temporary:
        assert is_temporary(temporary.name)
        temporary.write_text("x")
        assert not (tmp_path / "row.json").exists()
    assert (tmp_path / "row.json").read_text() == "x"
    assert not is_temporary("row.json")
    assert not is_temporary(".notes.partial")


def test_a_link_is_followed_to_a_file_and_what_is_no_file_is_written_itself(tmp_path):
    (tmp_path / "real").write_text("x")
    (tmp_path / "link").symlink_to("real")
    write_text(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"
    (tmp_path / "dangling").symlink_to("nowhere")
    with pytest.raises(InputError, match="leads to nothing"):
        write_text(tmp_path / "dangling", "x")
    temporary_of(tmp_path / "new").symlink_to("real")
    with pytest.raises(InputError, match="is a link"):
        write_text(tmp_path / "new", "x")
    assert (tmp_path / "real").read_text() == "new"
    write_text(Path(os.devnull), "x")
    assert not Path(os.devnull).is_file()
