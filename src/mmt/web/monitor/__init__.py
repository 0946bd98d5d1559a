"""The live monitor: what a running leader shows to a browser.

The tick and the link leave references in a tap; a task of its own makes messages of them some
25 times a second, once for all viewers. Without viewers nothing is done.
"""
