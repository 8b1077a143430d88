"""Equations (8), (11)-(22), (35)-(75) and Tables 2-4 as printed, in LaTeX, and the edits that repair (11)-(21).

Taken over by machine from the text of the paper, without change; only the line breaks are ours.
"""

EQUATIONS: dict[int, str] = {
    8: r"""{}^{i-1}T = \begin{bmatrix} C\theta_i & -S\theta_i & 0 & a_{i-1} \\ S\theta_i C\alpha_{i-1} &
        C\theta_i C\alpha_{i-1} & -S\alpha_{i-1} & -S\alpha_{i-1}d_i \\ S\theta_i S\alpha_{i-1} &
        C\theta_i S\alpha_{i-1} & C\alpha_{i-1} & C\alpha_{i-1}d_i \\ 0 & 0 & 0 & 1 \end{bmatrix}""",
    11: r"""N_x = \cos(\theta_6) \times (\cos(\theta_5) \times (\cos(\theta_4) \times \cos(\theta_2 +
        \theta_3) \times \cos(\theta_1) + \sin(\theta_1) \times \sin(\theta_1)) + \sin(\theta_5) \times
        \sin(\theta_2 + \theta_3) \times \cos(\theta_1) + \sin(\theta_6) \times (\sin(\theta_4) \times
        \cos(\theta_2 + \theta_3) \times \cos(\theta_1) - \cos(\theta_4) \times \sin(\theta_1)))""",
    12: r"""N_y = \cos(\theta_6) \times (\cos(\theta_5) \times (\cos(\theta_4) \times \cos(\theta_2 +
        \theta_3) \times \sin(\theta_1) - \sin(\theta_4) \times \cos(\theta_1)) + \sin(\theta_5) \times
        \sin(\theta_2 + \theta_3) \times \sin(\theta_1) + \sin(\theta_6) \times (\sin(\theta_4) \times
        \cos(\theta_2 + \theta_3) \times \sin(\theta_1) + \cos(\theta_4) \times \cos(\theta_1)))""",
    13: r"""N_z = \cos(\theta_6) \times (\cos(\theta_5) \times \cos(\theta_4) \times \sin(\theta_2 + \theta_3)
        - \sin(\theta_5) \times \cos(\theta_2 + \theta_3)) + \sin(\theta_6) \times \sin(\theta_4) \times
        \sin(\theta_2 + \theta_3)""",
    14: r"""B_x = -\sin(\theta_6) \times (\cos(\theta_5) \times (\cos(\theta_4) \times \cos(\theta_2 +
        \theta_3) \times \cos(\theta_1) + \sin(\theta_4) \times \sin(\theta_1)) + \sin(\theta_5) \times
        \sin(\theta_2 + \theta_3) \times \cos(\theta_1) + \cos(\theta_6) \times (\sin(\theta_4) \times
        \cos(\theta_2 + \theta_3) \times \cos(\theta_1) - \cos(\theta_4) \times \sin(\theta_1)))""",
    15: r"""B_y = -\sin(\theta_6) \times (\cos(\theta_5) \times (\cos(\theta_4) \times \cos(\theta_2 +
        \theta_3) \times \sin(\theta_1) - \sin(\theta_4) \times \cos(\theta_1)) + \sin(\theta_5) \times
        \sin(\theta_2 + \theta_3) \times \sin(\theta_1) + \cos(\theta_6) \times (\sin(\theta_4) \times
        \cos(\theta_2 + \theta_3) \times \sin(\theta_1) + \cos(\theta_4) \times \cos(\theta_1)))""",
    16: r"""B_z = -\sin(\theta_6) \times (\cos(\theta_5) \times \cos(\theta_4) \times \sin(\theta_2 +
        \theta_3) - \sin(\theta_5) \times \cos(\theta_2 + \theta_3)) + \cos(\theta_6) \times
        \sin(\theta_4) \times \sin(\theta_2 + \theta_3)""",
    17: r"""T_x = \sin(\theta_5) \times (\cos(\theta_4) \times \cos(\theta_2 + \theta_3) \times \cos(\theta_1)
        + \sin(\theta_4) \times \sin(\theta_1)) - \cos(\theta_5) \times \sin(\theta_2 + \theta_3) \times
        \cos(\theta_1)""",
    18: r"""T_y = \sin(\theta_5) \times (\cos(\theta_4) \times \cos(\theta_2 + \theta_3) \times \sin(\theta_1)
        - \sin(\theta_4) \times \cos(\theta_1)) - \cos(\theta_5) \times \sin(\theta_2 + \theta_3) \times
        \sin(\theta_1)""",
    19: r"""T_z = \sin(\theta_5) \times \cos(\theta_4) \times \sin(\theta_2 + \theta_3) + \cos(\theta_5)
        \times \cos(\theta_2 + \theta_3)""",
    20: r"""P_x = 0.4331 \times \sin(\theta_2 + \theta_3) \times \cos(\theta_1) + 0.0203 \times \cos(\theta_2
        + \theta_3) \times \cos(\theta_1) - 0.1491 \times \sin(\theta_1) + 0.4318 \times \cos(\theta_2
        \cos(\theta_1))""",
    21: r"""P_y = 0.4331 \times \sin(\theta_2 + \theta_3) \times \sin(\theta_1) + 0.0203 \times \cos(\theta_2
        + \theta_3) \times \sin(\theta_1) + 0.1491 \times \cos(\theta_1) + 0.4312 \times \cos(\theta_2)
        \times \sin(\theta_1)""",
    22: r"""P_z = -0.4331 \times \cos(\theta_2 + \theta_3) + 0.0203 \times \sin(\theta_2 + \theta_3) + 0.4318
        \times \sin(\theta_2)""",
    35: r"""A(\theta) \begin{bmatrix} \ddot{\theta}_1 \\ \ddot{\theta}_2 \\ \ddot{\theta}_3 \\ \ddot{\theta}_4
        \\ \ddot{\theta}_5 \\ \ddot{\theta}_6 \end{bmatrix} + B(\theta) \begin{bmatrix} \dot{\theta}_1
        \dot{\theta}_2 \\ \dot{\theta}_1 \dot{\theta}_3 \\ \dot{\theta}_1 \dot{\theta}_4 \\ \dot{\theta}_1
        \dot{\theta}_5 \\ \dot{\theta}_1 \dot{\theta}_6 \\ \dot{\theta}_2 \dot{\theta}_3 \\ \dot{\theta}_2
        \dot{\theta}_4 \\ \dot{\theta}_2 \dot{\theta}_5 \\ \dot{\theta}_2 \dot{\theta}_6 \\ \dot{\theta}_3
        \dot{\theta}_4 \\ \dot{\theta}_3 \dot{\theta}_5 \\ \dot{\theta}_3 \dot{\theta}_6 \\ \dot{\theta}_4
        \dot{\theta}_5 \\ \dot{\theta}_4 \dot{\theta}_6 \\ \dot{\theta}_5 \dot{\theta}_6 \end{bmatrix} +
        C(\theta) \begin{bmatrix} \dot{\theta}_1^2 \\ \dot{\theta}_2^2 \\ \dot{\theta}_3^2 \\
        \dot{\theta}_4^2 \\ \dot{\theta}_5^2 \\ \dot{\theta}_6^2 \end{bmatrix} + G(\theta) =
        \begin{bmatrix} \tau_1 \\ \tau_2 \\ \tau_3 \\ \tau_4 \\ \tau_5 \\ \tau_6 \end{bmatrix}""",
    36: r"""A(q) = \begin{bmatrix} A_{11} & A_{12} & A_{13} & 0 & 0 & 0 \\ A_{21} & A_{22} & A_{23} & 0 & 0 &
        0 \\ A_{31} & A_{32} & A_{33} & 0 & A_{35} & 0 \\ 0 & 0 & 0 & A_{44} & 0 & 0 \\ 0 & 0 & 0 & 0 &
        A_{55} & 0 \\ 0 & 0 & 0 & 0 & 0 & A_{66} \end{bmatrix}""",
    37: r"""A_{11} = I_{m1} + I_1 + I_3 \times \cos(\theta_2) \cos(\theta_2) + I_7 \sin(\theta_2 + \theta_3)
        \sin(\theta_2 + \theta_3) + I_{10} \sin(\theta_2 + \theta_3) \cos(\theta_2 + \theta_3) + I_{11}
        \sin(\theta_2) \cos(\theta_2) + I_{21} \sin(\theta_2 + \theta_3) \sin(\theta_2 + \theta_3) + 2 +
        [I_5 \cos(\theta_2) \sin(\theta_2 + \theta_3) + I_{12} \cos(\theta_2) \cos(\theta_2 + \theta_3) +
        I_{15} \sin(\theta_2 + \theta_3) \sin(\theta_2 + \theta_3) + I_{16} \cos(\theta_2) \sin(\theta_2 +
        \theta_3) + I_{22} \sin(\theta_2 + \theta_3) \cos(\theta_2 + \theta_3)]""",
    38: r"""A_{12} = I_4 \sin(\theta_2) + I_8 \cos(\theta_2 + \theta_3) + I_9 \cos(\theta_2) + I_{13}
        \sin(\theta_2 + \theta_3) - I_{18} \cos(\theta_2 + \theta_3)""",
    39: r"""A_{13} = I_8 \cos(\theta_2 + \theta_3) + I_{13} \sin(\theta_2 + \theta_3) - I_{18} \cos(\theta_2 +
        \theta_3)""",
    40: r"""A_{22} = I_{m2} + I_2 + I_6 + 2[I_5 \sin(\theta_3) + I_{12} \cos(\theta_2) + I_{15} + I_{16}
        \sin(\theta_3)]""",
    41: r"""A_{23} = I_5 \sin(\theta_3) + I_6 + I_{12} \cos(\theta_3) + I_{16} \sin(\theta_3) + 2I_{15}""",
    42: r"""A_{33} = I_{m3} + I_6 + 2I_{15}""",
    43: r"""A_{35} = I_{15} + I_{17}""",
    44: r"""A_{44} = I_{m4} + I_{14}""",
    45: r"""A_{55} = I_{m5} + I_{17}""",
    46: r"""A_{66} = I_{m6} + I_{23}""",
    47: r"""A_{21} = A_{12}, A_{31} = A_{13} \text{ and } A_{32} = A_{23}""",
    48: r"""b(q) = \begin{bmatrix} b_{112} & b_{113} & 0 & b_{115} & 0 & b_{123} & 0 & 0 & 0 & 0 & 0 & 0 & 0 &
        0 & 0 \\ 0 & 0 & b_{214} & 0 & 0 & b_{223} & 0 & b_{225} & 0 & 0 & b_{235} & 0 & 0 & 0 & 0 \\ 0 &
        0 & b_{314} & 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0 \\ b_{412} & b_{413} & 0 & b_{415} & 0
        & 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0 \\ 0 & 0 & b_{514} & 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0
        & 0 & 0 \\ 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0 & 0 \end{bmatrix}""",
    49: r"""b_{112} = 2[-I_3 \sin(\theta_2) \cos(\theta_2) + I_5 \cos(\theta_2 + \theta_2 + \theta_3) + I_7
        \sin(\theta_2 + \theta_3) \cos(\theta_2 + \theta_3) - I_{12} \sin(\theta_2 + \theta_2 + \theta_3)
        - I_{15} 2 \sin(\theta_2 + \theta_3) \cos(\theta_2 + \theta_3) + I_{16} \cos(\theta_2 + \theta_2 +
        \theta_3) + I_{21} \sin(\theta_2 + \theta_3) \cos(\theta_2 + \theta_3) + I_{22} (1 - 2
        \sin(\theta_2 + \theta_3) \sin(\theta_2 + \theta_3))] + I_{10} (1 - 2 \sin(\theta_2 + \theta_3)
        \sin(\theta_2 + \theta_3)) + I_{11} (1 - 2 \sin(\theta_2) \sin(\theta_2))""",
    50: r"""b_{113} = 2[I_5 \cos(\theta_2) \cos(\theta_2 + \theta_3) + I_7 \sin(\theta_2 + \theta_3)
        \cos(\theta_2 + \theta_3) - I_{12} \cos(\theta_2) \sin(\theta_2 + \theta_2) + I_{15} 2
        \sin(\theta_2 + \theta_3) \cos(\theta_2 + \theta_3) + I_{16} \cos(\theta_2) \cos(\theta_2 +
        \theta_3) + I_{21} \sin(\theta_2 + \theta_3) \cos(\theta_2 + \theta_3) + I_{22} (1 - 2
        \sin(\theta_2 + \theta_3) \sin(\theta_2 + \theta_3))] + I_{10} (1 - 2 \sin(\theta_2 + \theta_3)
        \sin(\theta_2 + \theta_3))""",
    51: r"""b_{115} = 2[-\sin(\theta_2 + \theta_3) \cos(\theta_2 + \theta_3) + I_{15} 2 \sin(\theta_2 +
        \theta_3) \cos(\theta_2 + \theta_3) + I_{16} \cos(\theta_2) \cos(\theta_2 + \theta_3) + I_{22}
        \cos(\theta_2 + \theta_3) \cos(\theta_2 + \theta_3)]""",
    52: r"""b_{123} = 2[-I_8 \sin(\theta_2 + \theta_3) + I_{13} \cos(\theta_2 + \theta_3) + I_{18}
        \sin(\theta_2 + \theta_3)]""",
    53: r"""b_{214} = I_{14} \sin(\theta_2 + \theta_3) + I_{19} \sin(\theta_2 + \theta_3) + 2I_{20}
        \sin(\theta_2 + \theta_3)(1 - 0.5)""",
    54: r"""b_{223} = 2[-I_{12} \sin(\theta_3) + I_5 \cos(\theta_3) + I_{16} \cos(\theta_3)]""",
    55: r"""b_{235} = 2[I_{16} \cos(\theta_3) + I_{22}]""",
    56: r"""b_{314} = 2[I_{20} \sin(\theta_2 + \theta_3)(1 - 0.5)] + I_{14} \sin(\theta_2 + \theta_3) + I_{19}
        \sin(\theta_2 + \theta_3)""",
    57: r"""b_{412} = b_{214} = -[I_{14} \sin(\theta_2 + \theta_3) + I_{19} \sin(\theta_2 + \theta_3) +
        2I_{20} \sin(\theta_2 + \theta_3)(1 - 0.5)]""",
    58: r"""b_{413} = -b_{314} = -2[I_{20} \sin(\theta_2 + \theta_3)(1 - 0.5)] + I_{14} \sin(\theta_2 +
        \theta_3) + I_{19} \sin(\theta_2 + \theta_3)""",
    59: r"""b_{415} = -I_{20} \sin(\theta_2 + \theta_3) - I_{17} \sin(\theta_2 + \theta_3)""",
    60: r"""b_{514} = -b_{415} = I_{20} \sin(\theta_2 + \theta_3) + I_{17} \sin(\theta_2 + \theta_3)""",
    61: r"""[b(q) \cdot \dot{q}\dot{q}]_{6 \times 1} = \begin{bmatrix} b_{112} \cdot q_1 \dot{q}_2 + b_{113}
        \cdot q_1 \dot{q}_3 + 0 + b_{115} \cdot q_1 \dot{q}_5 + b_{123} \cdot q_2 \dot{q}_3 \\ 0 + b_{214}
        \cdot q_1 \dot{q}_4 + b_{223} \cdot q_2 \dot{q}_3 + b_{225} \cdot q_2 \dot{q}_5 + b_{235} \cdot
        q_3 \dot{q}_5 \\ b_{314} \cdot q_1 \dot{q}_4 \\ b_{412} \cdot q_1 \dot{q}_2 + b_{413} \cdot q_1
        \dot{q}_3 + b_{415} \cdot q_1 \dot{q}_5 \\ b_{514} \cdot q_1 \dot{q}_4 \\ 0 \end{bmatrix}""",
    62: r"""C(q) = \begin{bmatrix} 0 & C_{12} & C_{13} & 0 & 0 & 0 \\ C_{21} & 0 & C_{23} & 0 & 0 & 0 \\
        C_{31} & C_{32} & 0 & 0 & 0 & 0 \\ 0 & 0 & 0 & 0 & 0 & 0 \\ C_{51} & C_{52} & 0 & 0 & 0 & 0 \\ 0 &
        0 & 0 & 0 & 0 & 0 \end{bmatrix}""",
    63: r"""c_{12} = I_4 \cos(\theta_2) - I_8 \sin(\theta_2 + \theta_3) - I_9 \sin(\theta_2) + I_{13}
        \cos(\theta_2 + \theta_3) + I_{18} \sin(\theta_2 + \theta_3)""",
    64: r"""c_{13} = 0.5b_{123} = -I_8 \sin(\theta_2 + \theta_3) + I_{13} \cos(\theta_2 + \theta_3) + I_{18}
        \sin(\theta_2 + \theta_3)""",
    65: r"""c_{21} = -0.5b_{112} = I_3 \sin(\theta_2) \cos(\theta_2) - I_5 \cos(\theta_2 + \theta_2 +
        \theta_3) - I_7 \sin(\theta_2 + \theta_3) \cos(\theta_2 + \theta_3) + I_{12} \sin(\theta_2 +
        \theta_2 + \theta_3) + I_{15} 2 \sin(\theta_2 + \theta_3) \cos(\theta_2 + \theta_3) - I_{16}
        \cos(\theta_2 + \theta_2 + \theta_3) - I_{21} \sin(\theta_2 + \theta_3) \cos(\theta_2 + \theta_3)
        - I_{22} (1 - 2 \sin(\theta_2 + \theta_3) \sin(\theta_2 + \theta_3)) - 0.5I_{10} (1 - 2
        \sin(\theta_2 + \theta_3) \sin(\theta_2 + \theta_3)) - 0.5I_{11} (1 - 2 \sin(\theta_2)
        \sin(\theta_2))""",
    66: r"""c_{22} = 0.5b_{223} = -I_{12} \sin(\theta_3) + I_5 \cos(\theta_3) + I_{16} \cos(\theta_3)""",
    67: r"""c_{23} = -0.5b_{113} = -I_5 \cos(\theta_2) \cos(\theta_2 + \theta_3) - I_7 \sin(\theta_2 +
        \theta_3) \cos(\theta_2 + \theta_3) + I_{12} \cos(\theta_2) \sin(\theta_2 + \theta_3) - I_{15} 2
        \sin(\theta_2 + \theta_3) \cos(\theta_2 + \theta_3) - I_{16} \cos(\theta_2) \cos(\theta_2 +
        \theta_3) - I_{21} \sin(\theta_2 + \theta_3) \cos(\theta_2 + \theta_3) - I_{22} (1 - 2
        \sin(\theta_2 + \theta_3) \sin(\theta_2 + \theta_3)) - 0.5I_{10} (1 - 2 \sin(\theta_2 + \theta_3)
        \sin(\theta_2 + \theta_3))""",
    68: r"""c_{31} = -c_{23} = I_{12} \sin(\theta_3) - I_5 \cos(\theta_3) - I_{16} \cos(\theta_3)""",
    69: r"""c_{32} = -0.5b_{115} = \sin(\theta_2 + \theta_3) \cos(\theta_2 + \theta_3) - I_{15} 2
        \sin(\theta_2 + \theta_3) \cos(\theta_2 + \theta_3) - I_{16} \cos(\theta_2) \cos(\theta_2 +
        \theta_3) - I_{22} \cos(\theta_2 + \theta_3) \cos(\theta_2 + \theta_3)""",
    70: r"""c_{52} = -0.5b_{225} = -I_{16} \cos(\theta_3) - I_{22}""",
    71: r"""[C(q) \cdot \dot{q}^2]_{6 \times 1} = \begin{bmatrix} c_{12} \cdot q_2^2 + c_{13} \cdot q_3^2 \\
        c_{21} \cdot q_1^2 + c_{23} \cdot q_3^2 \\ c_{13} \cdot q_1^2 + c_{32} \cdot q_2^2 \\ 0 \\ c_{51}
        \cdot q_1^2 + c_{52} \cdot q_2^2 \\ 0 \end{bmatrix}""",
    72: r"""[G(q)]_{6 \times 1} = \begin{bmatrix} 0 \\ G_2 \\ G_3 \\ 0 \\ G_5 \\ 0 \end{bmatrix}""",
    73: r"""G_2 = g_1 \cos(\theta_2) + g_2 \sin(\theta_2 + \theta_3) + g_3 \sin(\theta_2) + g_4 \cos(\theta_2
        + \theta_3) + g_5 \sin(\theta_2 + \theta_3)""",
    74: r"""G_3 = g_2 \sin(\theta_2 + \theta_3) + g_4 \cos(\theta_2 + \theta_3) + g_5 \sin(\theta_2 +
        \theta_3)""",
    75: r"""G_5 = g_5 \sin(\theta_2 + \theta_3)""",
}
"""Number of the equation -> its LaTeX, without the number."""

REPAIRS: dict[int, tuple[tuple[str, str], ...]] = {
    11: (
        (r"\sin(\theta_1) \times \sin(\theta_1)", r"\sin(\theta_4) \times \sin(\theta_1)"),
        (r" + \sin(\theta_6)", r") + \sin(\theta_6)"),
        (")))", "))"),
    ),
    12: ((r" + \sin(\theta_6)", r") + \sin(\theta_6)"), (")))", "))")),
    14: ((r" + \cos(\theta_6)", r") + \cos(\theta_6)"), (")))", "))")),
    15: ((r" + \cos(\theta_6)", r") + \cos(\theta_6)"), (")))", "))")),
    20: ((r"\cos(\theta_2 \cos(\theta_1))", r"\cos(\theta_2) \cos(\theta_1)"),),
    21: (("0.4312", "0.4318"),),
}
"""Number -> (printed, repaired) pieces of the LaTeX, each occurring once, replaced in this order."""

TABLE_2 = (
    r"1 & \theta_1 & -\pi/2 & 0 & 0",
    r"2 & \theta_2 & 0 & 0.4318 & 0.14909",
    r"3 & \theta_3 & \pi/2 & 0.0203 & 0",
    r"4 & \theta_4 & -\pi/2 & 0 & 0.43307",
    r"5 & \theta_5 & \pi/2 & 0 & 0",
    r"6 & \theta_6 & 0 & 0 & 0.05625",
)
"""Rows of Table 2: link, theta [rad], alpha [rad], a [m], d [m]."""

TABLES_3_AND_4 = (
    r"I_1 = 1.43 \pm 0.05",
    r"I_2 = 1.75 \pm 0.07",
    r"I_3 = 1.38 \pm 0.05",
    r"I_4 = 0.69 \pm 0.02",
    r"I_5 = 0.372 \pm 0.031",
    r"I_6 = 0.333 \pm 0.016",
    r"I_7 = 0.298 \pm 0.029",
    r"I_8 = -0.134 \pm 0.014",
    r"I_9 = 0.0238 \pm 0.012",
    r"I_{10} = -0.0213 \pm 0.0022",
    r"I_{11} = -0.0142 \pm 0.0070",
    r"I_{12} = -0.011 \pm 0.0011",
    r"I_{13} = -0.00379 \pm 0.0009",
    r"I_{14} = 0.00164 \pm 0.000070",
    r"I_{15} = 0.00125 \pm 0.0003",
    r"I_{16} = 0.00124 \pm 0.0003",
    r"I_{17} = 0.000642 \pm 0.0003",
    r"I_{18} = 0.000431 \pm 0.00013",
    r"I_{19} = 0.0003 \pm 0.0014",
    r"I_{20} = -0.000202 \pm 0.0008",
    r"I_{21} = -0.0001 \pm 0.0006",
    r"I_{22} = -0.000058 \pm 0.000015",
    r"I_{23} = 0.00004 \pm 0.00002",
    r"I_{m1} = 1.14 \pm 0.27",
    r"I_{m2} = 4.71 \pm 0.54",
    r"I_{m3} = 0.827 \pm 0.093",
    r"I_{m4} = 0.2 \pm 0.016",
    r"I_{m5} = 0.179 \pm 0.014",
    r"I_{m6} = 0.193 \pm 0.016",
    r"g_1 = -37.2 \pm 0.5",
    r"g_2 = -8.44 \pm 0.20",
    r"g_3 = 1.02 \pm 0.50",
    r"g_4 = 0.249 \pm 0.025",
    r"g_5 = -0.0282 \pm 0.0056",
)
"""Entries of Tables 3 [kg m^2] and 4 [N m]."""
