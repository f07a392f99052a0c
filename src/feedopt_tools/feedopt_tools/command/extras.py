"""The extras of an installation: what a command says where the packages that it needs were left out."""

from __future__ import annotations

# Import names of what requirements/view.in and requirements/test.in list; a test compares them with these files.
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
    """What to say where ``module`` cannot be imported; None where it belongs to no extra, which is an error of ours."""
    package = module.partition(".")[0]
    extra = EXTRA_OF_MODULE.get(package)
    if extra is None:
        return None
    return (
        f"{package} is not installed; {_PURPOSES[extra]} need the extra {extra}: "
        f"call FEEDOPT_EXTRAS=view,test ./feedopt once, or pip install -r requirements/{extra}.txt"
    )
