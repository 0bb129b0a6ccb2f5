"""The geometry prior: refined poses and a dense coloured cloud from posed frames."""
