"""Studies in closed loop: runs, their record and KPIs, hindsight, and sweeps."""
