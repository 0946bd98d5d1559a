"""The harness of the laboratory: code that all experiments share.

An experiment is a module of `mmt_lab.experiments`; see `mmt_lab.harness.experiment`. It returns
`Findings`, which the harness prints, writes as JSON and writes as a report.
"""
