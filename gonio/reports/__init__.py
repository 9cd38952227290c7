"""What a report says and shows: subjects, their views, figures, tables of values, and the page they make."""
