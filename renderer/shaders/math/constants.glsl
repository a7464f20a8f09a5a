// Numbers that several pieces share.
const float PI = 3.14159265358979;
const float TWO_PI = 6.28318530717959;
const float HALF_PI = 1.57079632679490;
const float INV_TWO_PI = 0.159154943091895;
const float INV_FOUR_PI = 0.0795774715459477;
