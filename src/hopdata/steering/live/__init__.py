"""The loop of Fig. 3.4 over a real-time motion-capture stream, and a loopback server for it."""
