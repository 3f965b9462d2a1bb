"""What a whole study comes to: tables, conditions, groups, outliers and its page."""
