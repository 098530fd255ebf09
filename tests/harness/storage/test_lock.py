import os
import signal
import subprocess
import sys

import pytest

from harness.common.errors import InputError
from harness.storage.lock import lock_beside, lock_within, remove_stale_locks

HOLD = (
    "import sys, time; from pathlib import Path; from harness.storage.lock import lock_beside;"
    "lock = lock_beside(Path(sys.argv[1])); print('held', flush=True); time.sleep(60)"
)


def test_a_lock_keeps_others_off_and_is_gone_without_a_trace(tmp_path):
    lock = lock_within(tmp_path)
    with pytest.raises(InputError, match="`out`: another process is writing"):
        lock_within(tmp_path)
    lock.release()
    lock.release()
    assert list(tmp_path.iterdir()) == []
    lock_within(tmp_path).release()


def test_a_killed_process_leaves_no_lock_behind(tmp_path):
    holder = subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path / "run")], stdout=subprocess.PIPE, text=True)
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    with pytest.raises(InputError, match="another process"):
        lock_beside(tmp_path / "run")
    remove_stale_locks(tmp_path)
    assert len(list(tmp_path.iterdir())) == 1
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    holder.stdout.close()
    lock_beside(tmp_path / "run").release()
    assert list(tmp_path.iterdir()) == []


def test_a_link_or_pipe_with_the_locks_name_is_neither_written_nor_waited_for(tmp_path):
    (tmp_path / "precious").write_text("x")
    (tmp_path / ".run.mmpf-harness-lock").symlink_to(tmp_path / "precious")
    with pytest.raises(OSError, match="symbolic links"):
        lock_beside(tmp_path / "run")
    os.mkfifo(tmp_path / ".other.mmpf-harness-lock")
    lock_beside(tmp_path / "other").release()
    assert (tmp_path / "precious").read_text() == "x"
