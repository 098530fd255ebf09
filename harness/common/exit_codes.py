"""The exit codes of all commands; scripts may rely on them."""

DONE, WORSE, WRONG_INPUT, RUN_FAILED, UNDECIDED, INTERNAL = 0, 1, 2, 3, 4, 70
HANGUP, INTERRUPTED, READER_GONE, TERMINATED = 129, 130, 141, 143

MEANINGS = {
    DONE: "success; for `compare`: no metric is worse by more than the tolerance, or undecided with "
    "`--allow-undecided`",
    WORSE: "`compare`: a metric is worse by more than the tolerance; `bench --against`: a step is slower; "
    "`.ci/reference.py --check`: a number differs or a table is of older code",
    WRONG_INPUT: "wrong input: one line names the option or file, the fault and the fix",
    RUN_FAILED: "a run failed, or its results could not be written; finished runs are kept; `check-tracker`: a "
    "check failed",
    UNDECIDED: "`compare`: undecided: there are too few runs, or runs or values are missing",
    INTERNAL: "internal error",
    HANGUP: "the terminal was closed (SIGHUP); finished runs are kept",
    INTERRUPTED: "interrupted by Ctrl-C (SIGINT); finished runs are kept",
    READER_GONE: "the reader of the output closed the pipe",
    TERMINATED: "terminated (SIGTERM, e.g. from `timeout`, a batch system or a shutdown); finished runs are kept",
}
"""What each exit code means, in Markdown."""
