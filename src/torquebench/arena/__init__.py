"""The arena: every law tuned alike, judged on draws that no tuning saw, and ranked with ties."""
