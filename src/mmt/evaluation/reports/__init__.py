"""What is written and drawn of evaluations: tables, figures, reports."""
