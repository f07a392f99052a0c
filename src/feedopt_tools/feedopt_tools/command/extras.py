"""The extras of an installation, and the message of a command whose packages are not installed."""

from __future__ import annotations

# Import names of the packages in requirements/view.in and requirements/test.in; a test compares them.
EXTRA_OF_MODULE = {
    "PIL": "view",
    "matplotlib": "view",
    "pyarrow": "view",
    "rerun": "view",
    "hypothesis": "test",
    "importlinter": "test",
    "mypy": "test",
    "pytest": "test",
    "ruff": "test",
}
_PURPOSES = {"view": "pictures, views, reports and Parquet files", "test": "the tests"}


def missing_extra(module: str) -> str | None:
    """Message if ``module`` cannot be imported; None if it belongs to no extra, which is an internal error."""
    package = module.partition(".")[0]
    extra = EXTRA_OF_MODULE.get(package)
    if extra is None:
        return None
    return (
        f"{package} is not installed; {_PURPOSES[extra]} need the extra {extra}: "
        f"run FEEDOPT_EXTRAS=view,test ./feedopt once, or pip install -r requirements/{extra}.txt"
    )
