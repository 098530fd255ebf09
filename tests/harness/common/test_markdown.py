import io
import sys

from harness.common.markdown import markdown_table, show_markdown

TEXT = "\n".join(["# Title", "", *markdown_table(["a", "b"], [["x", "1.5"]])])


class Screen(io.StringIO):
    def isatty(self):
        return True


def test_a_person_reads_a_laid_out_table_and_a_file_gets_markdown(monkeypatch, capsys):
    show_markdown(TEXT)
    assert capsys.readouterr().out == TEXT + "\n"
    screen = Screen()
    monkeypatch.setattr(sys, "stdout", screen)
    show_markdown(TEXT + "\n![errors](errors.png)")
    shown = screen.getvalue()
    assert "1.5" in shown
    assert "Title" in shown
    assert "|" not in shown
    assert "errors.png" not in shown


def test_a_wide_table_is_split_to_fit_80_columns_with_every_name_and_number_whole(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    headings = ["in the true traffic", *(f"tracker{k} less truth" for k in range(7))]
    rows = [["hard brakes (below -3 m/s²) a km", *(f"-{k}2.85 [-{k}1.25, +{k}4.46]" for k in range(7))]]
    show_markdown("\n".join(markdown_table(headings, rows)), on_stderr=True)
    shown = capsys.readouterr().err
    assert max(map(len, shown.splitlines())) <= 80
    assert "…" not in shown
    for k in range(7):
        assert f"tracker{k}" in shown
        assert f"-{k}2.85" in shown
        assert f"[-{k}1.25, +{k}4.46]" in shown
    assert shown.count("hard brakes") > 1


def test_each_part_of_a_wide_table_begins_with_all_that_tells_its_rows_apart(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "60")
    rows = [[name, world, *4 * ["1.25 [1.00, 1.50]"]] for name in ("mmpf", "pmbm") for world in ("as is", "dark")]
    show_markdown(
        "\n".join(markdown_table(["tracker", "world", *(f"score{k}" for k in range(4))], rows)), on_stderr=True
    )
    shown = capsys.readouterr().err
    assert shown.count("dark") == 2 * shown.count("tracker") > 2
