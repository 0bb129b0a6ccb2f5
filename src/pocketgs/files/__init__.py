"""Files: opening them safely, writing them atomically, and publishing several as one."""
