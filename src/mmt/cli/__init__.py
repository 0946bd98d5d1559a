"""The command lines: mmt, mmt-leader, mmt-follower.

Matrices are small, so threads of the linear algebra library would cost more time than they save
and take a core from the other service. The setting has effect only before NumPy is imported.
"""

import os

for _library in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_library, "1")
