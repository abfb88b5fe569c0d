"""Problems with known answers: each card is a module that measures, one command runs them all and writes the page."""
