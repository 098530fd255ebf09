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
