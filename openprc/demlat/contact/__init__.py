"""Contact of collidable nodes with each other and with faces.

`table` holds what a scene's contact needs, `search` finds who is near whom, `triangle` says
how near, `records` how the step began, `impacts` and `response` let bodies bounce, rub and
rest, `hook` ties that to the steps of a scheme, and `findings` says what cannot be done and
what a reader should know.
"""
