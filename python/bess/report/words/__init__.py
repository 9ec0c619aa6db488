"""What a report says in words and tables: summary, headline, how strings differ, the paper's statements."""
