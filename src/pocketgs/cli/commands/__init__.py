"""One file per subcommand, each a thin call of the public API."""
