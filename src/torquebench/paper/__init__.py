"""The paper's figures and claims: what is run, what is concluded from it, and the page that says so."""
