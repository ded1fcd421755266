"""The loop of Fig. 3.4 over a real-time stream, and a simulated source for it."""
