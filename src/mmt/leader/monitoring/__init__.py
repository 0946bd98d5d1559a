"""The live monitor: a web page that shows the running leader.

The tick and the link leave references to data. A separate task makes messages from them, by
default 25 times a second, once for all viewers. Without viewers it only follows the model.
"""
