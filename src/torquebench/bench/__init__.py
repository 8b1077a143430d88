"""Speed against peers: every figure a ratio within one run, every closed loop the one that ``torquebench run`` runs."""
