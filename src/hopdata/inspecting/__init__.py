"""What is in a recording, and what looks wrong, in words and tables.

`inspected` is what a notebook asks for, `listing` its text, `guesses` reads a file and
measures it, `devices` tells what the file holds beside markers, and `timeline` draws.
"""
