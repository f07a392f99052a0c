"""The tables in the README of the messages say what graph.yaml says."""

from __future__ import annotations

from pathlib import Path

from feedopt_node.graph import load_graph

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "src" / "feedopt_msgs" / "README.md"


def table(heading: str) -> list[list[str]]:
    """Rows of the table below a heading, without its head."""
    text = README.read_text(encoding="utf-8").split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
    rows = [line.strip("|").split("|") for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip().strip("`") for cell in row] for row in rows[2:]]


def test_topics() -> None:
    graph = load_graph(ROOT / "config" / "graph.yaml")
    expected = [
        [topic.name, topic.type, ", ".join(topic.publishers), ", ".join(topic.subscribers), topic.qos.name]
        for topic in graph.topics.values()
    ]
    assert table("Topics") == expected


def test_quality_of_service() -> None:
    graph = load_graph(ROOT / "config" / "graph.yaml")
    used = {topic.qos.name: topic.qos for topic in graph.topics.values()}
    expected = {name: [qos.reliability, qos.durability, str(qos.depth)] for name, qos in used.items()}
    assert {row[0]: row[1:4] for row in table("Quality of service")} == expected


def test_actions() -> None:
    graph = load_graph(ROOT / "config" / "graph.yaml")
    assert table("Action") == [[action.name, action.type, action.server] for action in graph.actions.values()]


def test_every_message_type_is_built() -> None:
    lists = (ROOT / "src" / "feedopt_msgs" / "CMakeLists.txt").read_text(encoding="utf-8")
    graph = load_graph(ROOT / "config" / "graph.yaml")
    for entry in (*graph.topics.values(), *graph.actions.values()):
        package, folder, name = entry.type.split("/")
        if package == "feedopt_msgs":
            assert f'"{folder}/{name}.{folder}"' in lists
            assert (ROOT / "src" / package / folder / f"{name}.{folder}").is_file()
