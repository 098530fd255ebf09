"""Errors that users meet: one sentence each. The command line prints it and returns its exit code."""


class InputError(Exception):
    """The input is wrong: exit code 2, the message on one line.

    The message names the parameter in backticks, as Python spells it, or the file, says what is wrong with it, and how
    to fix it. The command line spells the names of its own options as they are typed. Every function that takes what a
    user gave may raise it; a docstring says so where there is more to tell.
    """

    def __init__(self, message: str) -> None:
        """Take the message; what a library said in several lines becomes one."""
        super().__init__(" ".join(message.splitlines()))


class RunError(Exception):
    """A run failed part-way through no fault of the input: exit code 3; what was finished is kept."""


class SumoError(RunError):
    """SUMO failed, for the reason that it said."""

    def __init__(self, reason: str) -> None:
        """Take what it said."""
        super().__init__(f"SUMO failed: {reason}")
        self.reason = reason


class RunInterruptedError(Exception):
    """The user stopped a run: exit code 130; what was finished is kept."""
