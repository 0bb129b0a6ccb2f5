"""Files: safe opening, atomic writes, and publishing several files as one."""
