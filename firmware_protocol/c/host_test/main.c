/* Runs the reference codec on a PC.
 *
 *   host_test vectors FOLDER   checks the codec against the shared vectors; exit status 1 on the first difference
 *   host_test driver           answers one line on stdout for each line on stdin, so that another program can compare:
 *     feed SIDE IDLE SIZE WIRE       items of the decoder fed in pieces of SIZE bytes, then "dropped:N"
 *     encode TYPE SEQUENCE UPTIME BODY                the frame in hex
 *     request TYPE BODY              result and offset; when done the body built again from what was parsed
 *     message TYPE BODY              "valid" and the body built again from what was parsed, or "invalid"
 *     check IMAGE                    offset of the first refused element of a configuration, 65535 for none
 *     slot COUNTER IMAGE             the EEPROM slot
 *     newest SLOT SLOT               index, counter and image of the newest valid slot, or -1
 *     stream TS N                    N frames of the stream on a free line, each "ms:offset+length[,offset+length...]"
 *     can IMAGE STEP...              CAN over a struct whose bytes behind the configuration are 7 times their offset; steps:
 *                                    n:MS send what is due, o:INDEX on demand, r:MS:ID:DATA receive, x:MS time-outs.
 *                                    Answers "id:data" and "lost:index", at the end the three masks
 * Numbers are decimal, bytes hex, no bytes "-".
 */
#include <stdio.h>
#include <string.h>

#include "text.h"

int main(int argc, char **argv)
{
    if (argc == 3 && strcmp(argv[1], "vectors") == 0) {
        return vw_vectors_run(argv[2]);
    }
    if (argc == 2 && strcmp(argv[1], "driver") == 0) {
        return vw_driver_run();
    }
    fprintf(stderr, "usage: host_test vectors FOLDER | host_test driver\n");
    return 2;
}
