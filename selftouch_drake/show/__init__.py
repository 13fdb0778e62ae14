"""Everything for people: figures and the report (page), recordings and live play (meshcat)."""
