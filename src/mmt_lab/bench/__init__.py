"""Code that the stages of ``mmt bench`` share, and the command itself.

The stages are the experiments of `mmt_lab.experiments` whose ``GROUP`` is ``"bench"``.
"""
