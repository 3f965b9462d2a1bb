"""What every page has: head, sections, verdicts, references, and the HTML around them.

It knows no kind of page.
"""
