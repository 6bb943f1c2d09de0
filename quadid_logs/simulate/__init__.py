"""A nonlinear multirotor with known truth, flown closed-loop, logged like a real one."""
