"""Planning: from budgets of memory and time to the size of a run, before its work starts."""
