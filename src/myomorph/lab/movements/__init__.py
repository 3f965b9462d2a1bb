"""Numbers of movements other than walking, from forces as measured and from angles."""
