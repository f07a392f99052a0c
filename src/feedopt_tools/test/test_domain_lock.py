"""One graph a ROS domain."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from feedopt_node.errors import SecondGraphError
from feedopt_tools.execute.domain_lock import DomainLock, domain_id


def test_the_second_is_refused_and_told_who_holds_it(tmp_path: Path) -> None:
    with DomainLock(5, tmp_path):
        with pytest.raises(SecondGraphError, match=rf"domain 5 \(process {os.getpid()}\)"), DomainLock(5, tmp_path):
            pass
        with DomainLock(6, tmp_path):
            pass
    with DomainLock(5, tmp_path):
        pass


def test_the_lock_goes_with_its_process(tmp_path: Path) -> None:
    code = (
        "import sys, time, pathlib; from feedopt_tools.execute.domain_lock import DomainLock; "
        "lock = DomainLock(5, pathlib.Path(sys.argv[1])); lock.__enter__(); print('held', flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(SecondGraphError, match=rf"process {holder.pid}"), DomainLock(5, tmp_path):
            pass
        holder.kill()
    with DomainLock(5, tmp_path):
        pass


@pytest.mark.parametrize(("value", "domain"), [(None, 0), ("", 0), ("42", 42)])
def test_domain_of_the_environment(monkeypatch: pytest.MonkeyPatch, value: str | None, domain: int) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    if value is not None:
        monkeypatch.setenv("ROS_DOMAIN_ID", value)
    assert domain_id() == domain
