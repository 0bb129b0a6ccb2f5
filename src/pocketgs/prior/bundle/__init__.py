"""Bundle adjustment: Levenberg–Marquardt on poses and points, with the Schur complement."""
