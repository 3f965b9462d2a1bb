"""What was found, for people: events, tables, figures, pictures and one HTML page. Changes no result."""
