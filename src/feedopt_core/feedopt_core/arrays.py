"""The array types of the core; what is measured is float64."""

from __future__ import annotations

from typing import TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]
RecordArray: TypeAlias = NDArray[np.record]
"""Its elements have named fields, ``array[i].field``, in compiled code as well."""


def record(**fields: str) -> np.dtype[np.record]:
    """Type of the elements of a :data:`RecordArray`: fields by name, aligned, in this order in memory.

    Args:
        fields: type of each: ``"f8"`` a number, ``"i8"`` a whole one, ``"?"`` yes or no, ``"3f8"`` three numbers.
    """
    return cast("np.dtype[np.record]", np.dtype((np.record, np.dtype(list(fields.items()), align=True))))
