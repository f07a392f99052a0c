"""Fixtures of the graph tests."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest
from graph_run import RunningGraph, own_domain, running_graph


@pytest.fixture(scope="session", autouse=True)
def ros_domain() -> Iterator[None]:
    """Keep to this machine and to a domain of this test run."""
    before = dict(os.environ)
    os.environ["ROS_DOMAIN_ID"] = own_domain()
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    yield
    os.environ.clear()
    os.environ.update(before)


@pytest.fixture(scope="module")
def graph(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningGraph]:
    """A graph that serves the tests of a module one after the other."""
    with running_graph(tmp_path_factory.mktemp("graph")) as graph:
        yield graph
