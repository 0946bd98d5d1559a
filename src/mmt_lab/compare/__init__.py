"""Comparison of texture modelling methods: sessions, scores, summaries and tables."""
