"""Landings: floor, sections, contact instants, schedules, states, home frame."""
