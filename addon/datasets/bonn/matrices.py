"""Where a factor lies in a file, and its values."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import NacreError
from .cursor import Cursor

SCALARS: dict[int, np.dtype] = {2: np.dtype("<f2"), 4: np.dtype("<f4"), 8: np.dtype("<f8")}


@dataclass(frozen=True)
class Matrix:
    """rows x columns scalars, row by row, of which the first `used` columns count."""

    name: str
    offset: int
    rows: int
    columns: int
    scalar: np.dtype
    used: int

    @property
    def loaded_bytes(self) -> int:
        return 4 * self.rows * self.used

    def load(self, path: Path) -> np.ndarray:
        """float32 (rows, used); NacreError for a value that is not finite."""
        count = self.rows * self.columns
        try:
            raw = np.fromfile(path, self.scalar, count, offset=self.offset)
        except OSError as error:
            raise NacreError(f"cannot read {path}: {error.strerror}") from error
        if raw.size != count:
            raise NacreError(f"{path.name} was cut short while it was read")
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            values = raw.reshape(self.rows, self.columns)[:, : self.used].astype(np.float32)
        finite = np.isfinite(values).all(axis=1)
        if not finite.all():
            row = int(np.argmin(finite))
            raise NacreError(
                f"{path.name} is damaged: {self.name} has a value that is not a finite number in "
                f"row {row}"
            )
        return values


def read_scalar(cursor: Cursor, of: str) -> np.dtype:
    size = cursor.numbers("B", f"{of}'s scalars")[0]
    if size not in SCALARS:
        raise cursor.damaged(f"{of} has scalars of {size} bytes, not 2, 4 or 8")
    return SCALARS[size]


def place(
    cursor: Cursor, name: str, shape: tuple[int, int], scalar: np.dtype, used: int | None = None
) -> Matrix:
    """Pass over a matrix of this shape; NacreError where the file is too short for it."""
    rows, columns = shape
    offset = cursor.skip(rows * columns * scalar.itemsize, name)
    return Matrix(name, offset, rows, columns, scalar, columns if used is None else used)
