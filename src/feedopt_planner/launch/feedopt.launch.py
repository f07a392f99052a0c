"""The graph, for ``ros2 launch feedopt_planner feedopt.launch.py machine:=... method:=... record:=... sim:=...``.

``feedopt_node.graph`` defines the nodes to start and their parameters; this file converts them to launch actions.
"""

from __future__ import annotations

from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from feedopt_node.graph import ONE_THREAD, load_graph
from launch import LaunchContext, LaunchDescription

ARGUMENTS = (
    ("machine", "router_simulation", "machine file, or its name in config/machines"),
    ("method", "", "planning method; empty: as in config/nodes/planner.yaml"),
    ("record", "true", "record every topic"),
    ("sim", "true", "start the simulated router"),
)


def generate_launch_description() -> LaunchDescription:
    """Arguments, environment and nodes."""
    arguments = [DeclareLaunchArgument(name, default_value=value, description=text) for name, value, text in ARGUMENTS]
    environment = [SetEnvironmentVariable(name, value) for name, value in ONE_THREAD.items()]
    return LaunchDescription([*arguments, *environment, OpaqueFunction(function=_nodes)])


def _nodes(context: LaunchContext) -> list[Node]:
    chosen = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    graph = load_graph()
    present = graph.chosen_nodes(record=chosen["record"] == "true", sim=chosen["sim"] == "true")
    extra = {"planner": {"method": chosen["method"]}} if chosen["method"] else {}
    return [
        Node(
            package=process.package,
            executable=process.executable,
            name=process.name,
            parameters=[str(process.parameter_file), process.ros_parameters()],
            output="screen",
            # A graph without one of its nodes is of no use: all end together.
            on_exit=Shutdown(reason=f"{process.name} has ended"),
        )
        for process in graph.processes(present, chosen["machine"], extra)
    ]
