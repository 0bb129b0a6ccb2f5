"""Planning: choosing the size of a run from budgets of memory and time, before it starts."""
