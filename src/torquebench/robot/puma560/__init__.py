"""The PUMA 560: constants, closed forms equation by equation, and the public class."""
