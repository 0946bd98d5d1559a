"""Families of the cases of ``mmt stability``; `mmt_lab.stability.running` finds the modules."""
