/*
 * Lets user-mode Linux 6.1 run on processors with large register files (AMX); to be preloaded by it.
 *
 * The guest's kernel sets its processes' registers from a buffer of 2696 bytes, and Linux takes them only whole: on
 * such a processor they are 11 kB, ptrace says EFAULT, and the first process is killed. What the buffer leaves out
 * has not been touched by the guest, and zeros say so. Needs no header and no library, so any C compiler will do.
 */
#define SET_REGISTERS 0x4205L            /* PTRACE_SETREGSET */
#define EXTENDED_STATE ((void *)0x202)   /* NT_X86_XSTATE */
#define NEXT ((void *)-1L)               /* RTLD_NEXT */
#define MOST 65536UL

struct part {                            /* struct iovec */
    unsigned char *start;
    unsigned long length;
};
typedef long tracer(long, long, void *, void *);

void *dlsym(void *, const char *);

long ptrace(long request, long process, void *address, void *data)
{
    static unsigned char whole[MOST];
    tracer *next = (tracer *)dlsym(NEXT, "ptrace");
    struct part *given = data, passed;
    unsigned long k;

    if (request != SET_REGISTERS || address != EXTENDED_STATE || given->length > MOST)
        return next(request, process, address, data);
    for (k = 0; k < given->length; k++)
        whole[k] = given->start[k];
    passed.start = whole;
    passed.length = MOST;
    return next(request, process, address, &passed);
}
