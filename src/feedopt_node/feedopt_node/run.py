"""Start, spin and end of a node's process, and its exit codes."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

import rclpy
from rclpy.executors import Executor, ExternalShutdownException, MultiThreadedExecutor, SingleThreadedExecutor

from feedopt_core.errors import FailureKind, FeedoptError
from feedopt_node.graph_node import GraphNode
from feedopt_node.private_rclpy import RCLError

EXIT_OK = 0
EXIT_FAILURE = 1
EXIT_CONFIG = 2
EXIT_SECOND_GRAPH = 3
_EXIT_CODES = {FailureKind.CONFIG: EXIT_CONFIG, FailureKind.SECOND_GRAPH: EXIT_SECOND_GRAPH}

# On a signal, rclpy first wakes the executor and then shuts ROS down. An executor that checks in between still finds
# ROS running and waits again, for ever if nothing else wakes it (once in about 60 ends of the recorder).
_WAKE_PERIOD_S = 0.2


def run_node(factory: Callable[[], GraphNode[Any]], *, threads: int = 1, arguments: list[str] | None = None) -> int:
    """Create a node and spin it until SIGINT, SIGTERM or an error ends it.

    Args:
        factory: creates the node, after rclpy is initialised. ``close`` of the node is called at the end.
        threads: number of threads of the executor.
        arguments: command line; None: the command line of the process.

    Returns:
        Exit code: 0 after a signal, 1 after a failure, 2 for an invalid parameter or file, 3 if another graph was
        already running.
    """
    # The handler of rclpy shuts the context down. The handler of Python would raise KeyboardInterrupt even inside the
    # C++ code of rclpy.
    signal.signal(signal.SIGINT, _leave_to_rclpy)
    rclpy.init(args=arguments)
    executor: Executor = SingleThreadedExecutor() if threads == 1 else MultiThreadedExecutor(num_threads=threads)
    node: GraphNode[Any] | None = None
    try:
        node = factory()
        node.create_timer(_WAKE_PERIOD_S, _wake)
        executor.add_node(node)
        executor.spin_until_future_complete(node.life.ended)
        if node.life.ended.done():
            node.life.ended.result()
    except ExternalShutdownException:
        return EXIT_OK
    except RCLError:
        # The signal came while the executor was between its check and its wait.
        if rclpy.ok():
            raise
        return EXIT_OK
    except FeedoptError as error:
        print(f"{node.get_name()}: {error}" if node else error, file=sys.stderr, flush=True)
        return exit_code(error)
    finally:
        if node is not None:
            node.close()
        rclpy.try_shutdown()
    return EXIT_OK


def exit_code(error: FeedoptError) -> int:
    """Exit code of a process that ended with this error."""
    return _EXIT_CODES.get(error.kind, EXIT_FAILURE)


def _wake() -> None:
    """Do nothing: after every wait the executor itself checks whether ROS is running."""


def _leave_to_rclpy(number: int, frame: FrameType | None) -> None:
    """Signal handler that leaves the reaction to rclpy."""
