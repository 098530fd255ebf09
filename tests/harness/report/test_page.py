import json
import re
from html.parser import HTMLParser

import pandas as pd

from harness.commands.app import run_command_line
from harness.report.folder_page import write_page
from harness.report.page import write_run_page
from tests.harness.recorded_scene import metrics_of, write_recorded_scene


class Reader(HTMLParser):
    """Collects elements' addresses and, of script elements, the text."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.scripts: list[str] = []
        self.tags: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag == "script":
            self.scripts.append("")

    def handle_data(self, data):
        if self.tags and self.tags[-1] == "script":
            self.scripts[-1] += data


def read_page(path):
    reader = Reader()
    reader.feed(path.read_text(encoding="utf-8"))
    return reader


def test_a_runs_page_needs_nothing_but_itself(tmp_path):
    page = write_run_page(write_recorded_scene(tmp_path / "run"))
    addresses = read_page(page).addresses
    assert len(addresses) > 3
    assert [address for address in addresses if not address.startswith(("#", "data:"))] == []
    assert not re.search(r"url\(|@import|fetch\(|XMLHttpRequest", page.read_text(encoding="utf-8"))


def test_a_vehicles_name_cannot_break_the_page(tmp_path):
    name = "</script><img src=x onerror=alert(1)>"
    page = write_run_page(write_recorded_scene(tmp_path / "run", {"far": name}))
    reader = read_page(page)
    assert name in json.loads(reader.scripts[0])["vehicles"]["names"]
    assert "x" not in reader.addresses
    assert len(reader.scripts) == 6, (
        "the replay, its data, the charts, their data, their library, and what sorts a table"
    )


def test_a_metric_whose_module_is_not_imported_is_shown_by_its_key(tmp_path):
    folder = write_recorded_scene(tmp_path / "run")
    scores = metrics_of(folder) | {"mine": {"best": {"lon_m": 1.25}}}
    (folder / "metrics.json").write_text(json.dumps(scores))
    shown = "<th scope='row'>mine.best.lon_m</th><td>1.25</td>"
    assert shown in write_run_page(folder).read_text(encoding="utf-8")


def test_a_grids_folder_becomes_a_page_with_its_tables_and_pictures(tmp_path):
    folder = tmp_path / "grid"
    (folder / "figures").mkdir(parents=True)
    (folder / "table.md").write_text(
        "# Densities\n\n| density | hota |\n|---|---|\n| 20 | 91.5 |\n\n<script>x</script>\n"
    )
    (folder / "figures" / "hota.png").write_bytes(b"\x89PNG")
    pd.DataFrame({"seed": [0, 1], "mot.hota": [91.5, 90.25], "error": [None, None]}).to_parquet(folder / "runs.parquet")
    page = write_page(folder)
    text, reader = page.read_text(encoding="utf-8"), read_page(page)
    assert all(shown in text for shown in ("<td>91.5</td>", "90.25", "mot.hota"))
    assert "script" not in reader.tags
    assert [address for address in reader.addresses if address.startswith("data:image/png")]
    assert [address for address in reader.addresses if not address.startswith("data:")] == []


def test_the_command_names_the_page_and_its_size(tmp_path, capsys):
    folder = write_recorded_scene(tmp_path / "run")
    assert run_command_line(["report", str(folder), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["page"] == str(folder / "report.html")
    assert 0.0 < answer["size_mb"] < 2.0
    noted = json.loads((folder / "manifest.json").read_text()) | {"files_sha256": {"tracks.parquet": "0"}}
    (folder / "manifest.json").write_text(json.dumps(noted))
    assert run_command_line(["report", str(folder)]) == 0
    assert "tracks.parquet was changed after it was written" in capsys.readouterr().err


def test_somebody_elses_page_is_left_alone(tmp_path, refused):
    folder = write_recorded_scene(tmp_path / "run")
    (folder / "report.html").write_text("<p>mine</p>")
    assert "was not made by this program" in refused("report", folder)
    assert (folder / "report.html").read_text() == "<p>mine</p>"
    (folder / "report.html").unlink()
    assert run_command_line(["report", str(folder)]) == 0
    assert run_command_line(["report", str(folder)]) == 0, "its own page is replaced"


def test_a_folder_that_is_none_is_the_users_error(tmp_path, refused):
    refused("report", "nowhere")
    (tmp_path / "notes.md").write_text("# Mine\n")
    told = refused("report", tmp_path)
    assert all(word in told for word in (str(tmp_path), "a run's holds manifest.json", "a stress test's"))
    assert [path.name for path in tmp_path.iterdir()] == ["notes.md"]
