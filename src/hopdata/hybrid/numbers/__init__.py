"""Kinds of number for which a user's function of plain numbers compiles unchanged.

Ranges (`ranges`, `operators`, `arithmetic`, `functions`)
    The least and the largest value in a piece of a step, and those of its rate: by
    these, guards are proven.
Duals (`duals`, `dual_*`)
    A value and its slopes by several directions: by these, derivatives are exact.
Moving numbers (`moving`, `moving_*`)
    A value and its rate, each of which may be a plain number, a range or a dual: for
    the rates of guards that slide.
Traces (`traces`)
    Which states a number was made from: by these, patterns of Jacobians are found.

`vectors` and `new_arrays` are arrays of any of them; `answers`, `switches`, `modes` and
`guards` run the user's code with them.
"""
