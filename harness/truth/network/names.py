"""The names of the networks that come with the project; nothing that takes time to import is needed to check one."""

from pathlib import Path

from harness.common.errors import InputError
from harness.common.untrusted_files import checked_path

METADATA_FILE = "network.toml"


def shipped_networks() -> dict[str, Path]:
    """Return the folders of the networks that come with the project by name: in the package, or beside a checkout's."""
    package = Path(__file__).parents[2]
    installed = package / "networks"
    root = installed if installed.is_dir() else package.parent / "networks"
    return {entry.parent.name: entry.parent for entry in sorted(root.glob(f"*/{METADATA_FILE}"))}


def check_network(name_or_path: str) -> None:
    """Refuse what is neither the name of a network nor may be the path of one.

    Raises:
        InputError: There is no such network.
    """
    path, shipped = Path(name_or_path), shipped_networks()
    if name_or_path not in shipped and path.suffix != ".sumocfg" and not checked_path(path, "net").is_dir():
        known = ", ".join(shipped)
        raise InputError(
            f"`net` {name_or_path}: no such network; known are: {known}; or give a folder or a .sumocfg file"
        )
