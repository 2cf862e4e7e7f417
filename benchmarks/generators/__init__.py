"""Development sessions for the gap diagnosis, from two machines that share no physics code."""
