"""The sentences of the page: what is wrong with each misprinted equation, and what was read but not computed."""

WRONG: dict[int, str] = {
    11: "sin(theta1) sin(theta1) for sin(theta4) sin(theta1), as (14) has it; and the bracket opened after cos(theta6) "
    "closes at the end of the line instead of before the theta6 term, unlike in (13) and (16).",
    12: "The bracket opened after cos(theta6) closes at the end of the line instead of before the theta6 term.",
    14: "The bracket opened after sin(theta6) closes at the end of the line instead of before the theta6 term.",
    15: "The bracket opened after sin(theta6) closes at the end of the line instead of before the theta6 term.",
    20: "The cosine of theta2 cos(theta1) for the product of the two cosines; (21) has the product.",
    21: "0.4312 for 0.4318, the a2 of Table 2, (20) and (22).",
    36: "A35 has no partner: A53 is zero, and (47) lists A21, A31 and A32 only. The text before (24) says that A is "
    "symmetric.",
    37: "`+ 2 + [` for `+ 2 [`. A bare 2 stands among terms in kg m^2. With `2 [` its derivative by theta3 is (67) "
    "exactly.",
    40: "cos(theta2) beside I12 for cos(theta3), as (41) has it. A22 cannot depend on theta2, and (54) and (68) are "
    "derivatives of the corrected form.",
    49: "The sign of I15. The derivative of (37) by theta2 has plus; (50) and (67), by theta3, have it right. (65) "
    "repeats the minus, so the slip is the paper's.",
    50: "sin(theta2 + theta2) beside I12 for sin(theta2 + theta3), as in (67), which is said to be -0.5 b113.",
    51: "I20 is missing, which leaves sin cos without a constant among terms in kg m^2, and I15 has a factor 2 too "
    "many. (69) repeats both, so the slips are the paper's.",
    55: "The formula is right. b225, which (48), (61) and (70) use, is defined nowhere: it equals b235.",
    57: "The formula is right. The label also says b412 = b214, which has the other sign: a minus is lost there.",
    58: "The minus covers the first of three terms. (58) itself says -b314, and (56) is right.",
    61: "Each product has one dot where two belong (q1 for the speed of joint 1): kg m^2 rad/s x rad is no torque.",
    62: "The pattern is right. c51, which it and (71) use, is defined nowhere: it is (69), repaired.",
    65: "The sign of I15, as in (49).",
    66: "The formula is right; the label should be c23. (62) has no c22.",
    67: "The formula is right; the label should be c31.",
    68: "The formula is right; the label should be c32 = -c23.",
    69: "The label should be c51. The formula has the slips of (51): I20 is missing, I15 has a factor 2 too many.",
    71: "Row 3 has c13 where (62) has C31. The squares lack their dots. It refers to (34), the gravity vector, for "
    "(33).",
}
"""Number of the equation -> what is wrong and what in the paper itself shows it."""

NOTES = (
    "(3)-(5) are the rotation of standard Denavit-Hartenberg, Rot_z(theta) Rot_x(alpha); (8) is the modified "
    "convention, Rot_x(alpha) first. The text calls the parameters standard and defines them as the modified ones are "
    "(Z_i and Z_{i+1}). (8) itself is printed without a slip, apart from a lower index on its left side.",
    "(5) calls V a function of theta_i; it is one of alpha_i. Table 1, row N, has n for alpha_n.",
    "The text before (25) refers to (22) for (23).",
    "The list of speed products after (27) starts q1', q2', q1' q3'; the first comma should be a product. (35) has all "
    "15 products, in the order of (48).",
    "(32): the labels of the last row lack an index (b_{n-12} for b_{n12}, b_{n-1n} for b_{n1n} and b_{n,n-1,n}).",
    "(34) calls the entries of G g1 .. gn; in (73)-(75) g1 .. g5 are the constants of Table 4.",
    "(35) writes B(theta) for b(q). Before (76) [B] is the vector of Coriolis torques and [I] the sum of B, C and G, "
    "while I1 .. I23 are inertias; K in (77) is a torque, in (95) a gain.",
    "(53), (56)-(58): the factor (1 - 0.5) is what is left at theta4 = theta5 = 0; 2 I20 S23 (1 - 0.5) is I20 S23.",
    "(31) and (79): the double integral lacks dt dt and the initial position and speed. (76)-(78) are right.",
    "(26) makes V a vector of torques; (112) multiplies a matrix V by the speeds. That dA/dt - 2V is skew-symmetric, "
    "as the text before (111) says, holds for Christoffel's choice of that matrix; b and C do not single one out.",
)
"""Slips of notation and reference: read, not computed, except where a test is named on the page."""

FLAGS: dict[str, str] = {
    "36": "A53 = 0",
    "37": "A11 with + 2 +",
    "40": "A22 with cos(theta2)",
    "49": "b112",
    "50": "b113",
    "51": "b115",
    "55": "b225 = 0",
    "58": "b413",
    "62": "c51 = 0",
    "65": "c21",
    "67": "taken for c23",
    "68": "taken for c31",
    "69": "taken for c32",
    "71": "c13 in row 3",
}
"""Flags of the model: what is different when that equation is taken as printed."""
