"""What a program says: streams, logs, metrics, tables, plots and their colours."""
