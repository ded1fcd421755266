"""Stages: the steps of a steering study, from plain options and tables to tables."""
