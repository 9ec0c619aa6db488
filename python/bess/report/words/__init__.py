"""Text and tables of a report: summary, headline, tables, and the statements of the paper."""
