"""How a demand is split among strings: rules, plans, certified splits, wear and explicit controllers."""
