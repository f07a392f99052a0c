from setuptools import find_packages, setup

PACKAGE = "feedopt_tools"

setup(
    name=PACKAGE,
    version="0.1.0",
    description="The feedopt command and what it needs",
    maintainer="feedopt maintainers",
    maintainer_email="maintainers@example.org",
    license="Apache-2.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={"": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "feedopt = feedopt_tools.command.main:main",
        ],
    },
)
