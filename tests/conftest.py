"""Every call of the package is checked for types and shapes; hypothesis and torch behave the same everywhere."""

import hypothesis
import torch
from jaxtyping import install_import_hook

install_import_hook("tvae", "checking.checked")
hypothesis.settings.register_profile("tvae", deadline=None, derandomize=True, database=None)
hypothesis.settings.load_profile("tvae")
torch.set_num_threads(1)
