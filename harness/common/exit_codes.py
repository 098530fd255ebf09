"""The exit codes of all commands; scripts may rely on them."""

from __future__ import annotations

DONE, WORSE, WRONG_INPUT, RUN_FAILED, UNDECIDED, INTERNAL = 0, 1, 2, 3, 4, 70
HANGUP, INTERRUPTED, READER_GONE, TERMINATED = 129, 130, 141, 143

MEANINGS = {
    DONE: "done; of `compare`: no worse than the tolerance, or undecided with `--allow-undecided`",
    WORSE: "`compare`: something is worse by more than the tolerance; `reference --check`: a number differs",
    WRONG_INPUT: "wrong input: one line names the option or file and the mend",
    RUN_FAILED: "a run failed part-way, or could not be written; what was finished is kept",
    UNDECIDED: "`compare`: undecided: too few runs to tell, or runs or values are missing",
    INTERNAL: "an error of the program itself",
    HANGUP: "the terminal was closed (SIGHUP); what was finished is kept",
    INTERRUPTED: "interrupted by Ctrl-C (SIGINT); what was finished is kept",
    READER_GONE: "whoever read the output went away",
    TERMINATED: "told to end (SIGTERM, as from `timeout`, a batch system or a shutdown); what was finished is kept",
}
"""What each exit code means, in Markdown."""
