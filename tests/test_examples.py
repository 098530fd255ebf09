"""The commands that README and tutorials show run, and print the output that stands below them."""

import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SPEC = importlib.util.spec_from_file_location("examples", ROOT / ".ci" / "examples.py")
EXAMPLES = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(EXAMPLES)


@pytest.mark.slow
@pytest.mark.parametrize("page", EXAMPLES.PAGES, ids=lambda page: page.stem)
def test_the_commands_of_a_page_print_what_it_shows(page):
    EXAMPLES.current(page)


def test_blocks_marked_as_not_run_or_without_a_shell_are_no_examples():
    page = "<!-- not run: downloads -->\n```sh\na\n```\n```sh\nb\n```\n\n```\nout\n```\n```toml\nc\n```\n"
    assert list(EXAMPLES.examples(page)) == [("b\n", "out\n")]


def test_shown_lines_may_differ_from_printed_ones_in_their_numbers_only():
    printed = "cost  4.5\nother\nend   2\n"
    assert EXAMPLES.matched("cost 3.25\n...\nend 1\n", printed) == ["cost  4.5", "...", "end   2"]
    with pytest.raises(ValueError, match="is not printed"):
        EXAMPLES.matched("end 1\ncost 3\n", printed)
