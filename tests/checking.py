"""How the package's annotations are checked under pytest."""

import numpy as np
from beartype import BeartypeConf, FrozenDict, beartype
from numpy.typing import NDArray

floats = NDArray[np.float64]
fact = str | int | float | bool
checked = beartype(
    conf=BeartypeConf(
        hint_overrides=FrozenDict(
            {
                floats: floats | float,  # numpy gives scalars for arrays without axes
                fact: object,  # tests provoke the package's own error in words
            }
        ),
        is_pep484_tower=True,
        is_random=False,
    )
)
