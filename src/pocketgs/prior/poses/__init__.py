"""Poses held to the photographs: sparse points, wrong poses found and placed anew, the others refined."""
