from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "feedopt_planner"

setup(
    name=PACKAGE,
    version="0.1.0",
    description="The toolpath node and the planner node of the feedopt motion pipeline",
    maintainer="feedopt maintainers",
    maintainer_email="maintainers@example.org",
    license="Apache-2.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={"": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", [str(path) for path in sorted(Path().glob("launch/*.py"))]),
    ],
    install_requires=["setuptools"],
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "toolpath_node = feedopt_planner.toolpath_node:main",
            "planner_node = feedopt_planner.planner_node:main",
        ],
    },
)
