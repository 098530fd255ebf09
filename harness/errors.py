"""Errors that the command line turns into one line and an exit code."""


class UserError(Exception):
    """The user's input is wrong: exit code 2, the message on one line.

    The message names the option or file, says what is wrong with it, and how to mend it.
    """


class RunError(Exception):
    """A run failed part-way through no fault of the input: exit code 3; what was finished is kept."""


class RunInterruptedError(Exception):
    """The user stopped a run: exit code 130; what was finished is kept."""
