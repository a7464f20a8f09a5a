// MD5 (RFC 1321) of the 16 bytes of a key, as Tzeng and Wei 2008 make white noise on a GPU; the thesis's generator. Six times
// the work of pcg4d for nothing that a test could see; there for comparison.
uint md5_rotate(uint v, int bits) { return (v << bits) | (v >> (32 - bits)); }
uint md5_select(uint which, uint one, uint other) { return (which & one) | (~which & other); }
#define MD5_F(a, b, c, d, m, k, s) a = b + md5_rotate(a + md5_select(b, c, d) + m + k, s);
#define MD5_G(a, b, c, d, m, k, s) a = b + md5_rotate(a + md5_select(d, b, c) + m + k, s);
#define MD5_H(a, b, c, d, m, k, s) a = b + md5_rotate(a + (b ^ c ^ d) + m + k, s);
#define MD5_I(a, b, c, d, m, k, s) a = b + md5_rotate(a + (c ^ (b | ~d)) + m + k, s);

// Written out, since llvmpipe compiles loops slowly. The message is the key, one bit, and its length of 128 bits.
uvec4 md5(uvec4 key) {
    uint a = 0x67452301u;
    uint b = 0xefcdab89u;
    uint c = 0x98badcfeu;
    uint d = 0x10325476u;
    MD5_F(a, b, c, d, key.x, 0xd76aa478u, 7)
    MD5_F(d, a, b, c, key.y, 0xe8c7b756u, 12)
    MD5_F(c, d, a, b, key.z, 0x242070dbu, 17)
    MD5_F(b, c, d, a, key.w, 0xc1bdceeeu, 22)
    MD5_F(a, b, c, d, 0x80u, 0xf57c0fafu, 7)
    MD5_F(d, a, b, c, 0u, 0x4787c62au, 12)
    MD5_F(c, d, a, b, 0u, 0xa8304613u, 17)
    MD5_F(b, c, d, a, 0u, 0xfd469501u, 22)
    MD5_F(a, b, c, d, 0u, 0x698098d8u, 7)
    MD5_F(d, a, b, c, 0u, 0x8b44f7afu, 12)
    MD5_F(c, d, a, b, 0u, 0xffff5bb1u, 17)
    MD5_F(b, c, d, a, 0u, 0x895cd7beu, 22)
    MD5_F(a, b, c, d, 0u, 0x6b901122u, 7)
    MD5_F(d, a, b, c, 0u, 0xfd987193u, 12)
    MD5_F(c, d, a, b, 128u, 0xa679438eu, 17)
    MD5_F(b, c, d, a, 0u, 0x49b40821u, 22)
    MD5_G(a, b, c, d, key.y, 0xf61e2562u, 5)
    MD5_G(d, a, b, c, 0u, 0xc040b340u, 9)
    MD5_G(c, d, a, b, 0u, 0x265e5a51u, 14)
    MD5_G(b, c, d, a, key.x, 0xe9b6c7aau, 20)
    MD5_G(a, b, c, d, 0u, 0xd62f105du, 5)
    MD5_G(d, a, b, c, 0u, 0x02441453u, 9)
    MD5_G(c, d, a, b, 0u, 0xd8a1e681u, 14)
    MD5_G(b, c, d, a, 0x80u, 0xe7d3fbc8u, 20)
    MD5_G(a, b, c, d, 0u, 0x21e1cde6u, 5)
    MD5_G(d, a, b, c, 128u, 0xc33707d6u, 9)
    MD5_G(c, d, a, b, key.w, 0xf4d50d87u, 14)
    MD5_G(b, c, d, a, 0u, 0x455a14edu, 20)
    MD5_G(a, b, c, d, 0u, 0xa9e3e905u, 5)
    MD5_G(d, a, b, c, key.z, 0xfcefa3f8u, 9)
    MD5_G(c, d, a, b, 0u, 0x676f02d9u, 14)
    MD5_G(b, c, d, a, 0u, 0x8d2a4c8au, 20)
    MD5_H(a, b, c, d, 0u, 0xfffa3942u, 4)
    MD5_H(d, a, b, c, 0u, 0x8771f681u, 11)
    MD5_H(c, d, a, b, 0u, 0x6d9d6122u, 16)
    MD5_H(b, c, d, a, 128u, 0xfde5380cu, 23)
    MD5_H(a, b, c, d, key.y, 0xa4beea44u, 4)
    MD5_H(d, a, b, c, 0x80u, 0x4bdecfa9u, 11)
    MD5_H(c, d, a, b, 0u, 0xf6bb4b60u, 16)
    MD5_H(b, c, d, a, 0u, 0xbebfbc70u, 23)
    MD5_H(a, b, c, d, 0u, 0x289b7ec6u, 4)
    MD5_H(d, a, b, c, key.x, 0xeaa127fau, 11)
    MD5_H(c, d, a, b, key.w, 0xd4ef3085u, 16)
    MD5_H(b, c, d, a, 0u, 0x04881d05u, 23)
    MD5_H(a, b, c, d, 0u, 0xd9d4d039u, 4)
    MD5_H(d, a, b, c, 0u, 0xe6db99e5u, 11)
    MD5_H(c, d, a, b, 0u, 0x1fa27cf8u, 16)
    MD5_H(b, c, d, a, key.z, 0xc4ac5665u, 23)
    MD5_I(a, b, c, d, key.x, 0xf4292244u, 6)
    MD5_I(d, a, b, c, 0u, 0x432aff97u, 10)
    MD5_I(c, d, a, b, 128u, 0xab9423a7u, 15)
    MD5_I(b, c, d, a, 0u, 0xfc93a039u, 21)
    MD5_I(a, b, c, d, 0u, 0x655b59c3u, 6)
    MD5_I(d, a, b, c, key.w, 0x8f0ccc92u, 10)
    MD5_I(c, d, a, b, 0u, 0xffeff47du, 15)
    MD5_I(b, c, d, a, key.y, 0x85845dd1u, 21)
    MD5_I(a, b, c, d, 0u, 0x6fa87e4fu, 6)
    MD5_I(d, a, b, c, 0u, 0xfe2ce6e0u, 10)
    MD5_I(c, d, a, b, 0u, 0xa3014314u, 15)
    MD5_I(b, c, d, a, 0u, 0x4e0811a1u, 21)
    MD5_I(a, b, c, d, 0x80u, 0xf7537e82u, 6)
    MD5_I(d, a, b, c, 0u, 0xbd3af235u, 10)
    MD5_I(c, d, a, b, key.z, 0x2ad7d2bbu, 15)
    MD5_I(b, c, d, a, 0u, 0xeb86d391u, 21)
    return uvec4(a, b, c, d) + uvec4(0x67452301u, 0xefcdab89u, 0x98badcfeu, 0x10325476u);
}
