"""What other people keep recordings in: one module for each kind of file, `kinds.py` names all."""
