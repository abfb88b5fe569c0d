"""Hard cases, many of each kind: nothing may return NaN, hang, or claim convergence falsely."""
