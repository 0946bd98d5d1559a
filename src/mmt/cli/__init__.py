"""The command lines: mmt, mmt-leader, mmt-follower.

The matrices here are small: threads of the linear algebra library would cost more than they
gain, and take a core from the other service. The setting counts only before NumPy is loaded.
"""

import os

for _library in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_library, "1")
