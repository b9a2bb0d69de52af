// SPDX-License-Identifier: Apache-2.0
// A network that loses and reorders: preloaded into a process, it drops a share of its UDP datagrams and sends others
// after the next few. Where it drops all it sends, it hears nothing either: the process is cut off. It needs no right,
// as netem of the kernel would. Set up and steered by lossy_network.py.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define HELD 64
#define MOST_BYTES 65536
#define ALL 1000000

typedef ssize_t (*Send)(int, const void *, size_t, int, const struct sockaddr *, socklen_t);
typedef ssize_t (*SendMessage)(int, const struct msghdr *, int);
typedef ssize_t (*Receive)(int, void *, size_t, int, struct sockaddr *, socklen_t *);
typedef struct {
    int fd;  // -1: free
    int passes;  // datagrams that go before this one
    size_t size;
    socklen_t address_size;
    struct sockaddr_storage address;
    char *data;
} Datagram;

static Send send_now;
static SendMessage send_message_now;
static Receive receive_now;
static Datagram held[HELD];
static pthread_mutex_t turn = PTHREAD_MUTEX_INITIALIZER;
// Shared by all processes of a run: shares of a million to lose and to delay; counts of sent, lost and delayed ones.
typedef struct {
    uint64_t loss, delay, sent, lost, delayed;
} Network;
static Network spare, *network = &spare;
static uint64_t state;

static unsigned draw(unsigned below) {  // xorshift64*
    state ^= state >> 12;
    state ^= state << 25;
    state ^= state >> 27;
    return (unsigned)((state * 2685821657736338717ULL) >> 33) % below;
}

__attribute__((constructor)) static void begin(void) {
    send_now = (Send)dlsym(RTLD_NEXT, "sendto");
    send_message_now = (SendMessage)dlsym(RTLD_NEXT, "sendmsg");
    receive_now = (Receive)dlsym(RTLD_NEXT, "recvfrom");
    state = 0x9E3779B97F4A7C15ULL ^ ((uint64_t)getpid() << 20) ^ (uint64_t)time(NULL);
    for (int k = 0; k < HELD; k++) held[k].fd = -1;
    const char *name = getenv("LOSSY_NETWORK");
    int file = name ? open(name, O_RDWR) : -1;
    if (file >= 0) {
        void *shared = mmap(NULL, sizeof spare, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
        if (shared != MAP_FAILED) network = shared;
        close(file);
    }
}

static int is_datagram(int fd, const struct sockaddr *peer) {
    int kind = 0;
    socklen_t size = sizeof kind;
    return peer && peer->sa_family == AF_INET && !getsockopt(fd, SOL_SOCKET, SO_TYPE, &kind, &size) && kind == SOCK_DGRAM;
}

// Whether a datagram was lost or held back; those whose turn has come are sent. With the lock.
static int taken(int fd, const struct iovec *parts, size_t count, const struct sockaddr *to, socklen_t to_size) {
    size_t size = 0;
    for (size_t k = 0; k < count; k++) size += parts[k].iov_len;
    for (int k = 0; k < HELD; k++) {
        Datagram *one = &held[k];
        if (one->fd < 0 || one->passes-- > 0) continue;
        send_now(one->fd, one->data, one->size, 0, (struct sockaddr *)&one->address, one->address_size);
        free(one->data);
        one->fd = -1;
    }
    __atomic_add_fetch(&network->sent, 1, __ATOMIC_RELAXED);
    unsigned fate = draw(ALL);
    uint64_t loss = __atomic_load_n(&network->loss, __ATOMIC_RELAXED);
    if (fate < loss) {
        __atomic_add_fetch(&network->lost, 1, __ATOMIC_RELAXED);
        return 1;
    }
    if (fate >= loss + __atomic_load_n(&network->delay, __ATOMIC_RELAXED) || size > MOST_BYTES || to_size > sizeof(struct sockaddr_storage)) return 0;
    for (int k = 0; k < HELD; k++) {
        Datagram *one = &held[k];
        if (one->fd >= 0 || !(one->data = malloc(size ? size : 1))) continue;
        char *end = one->data;
        for (size_t j = 0; j < count; j++) end = mempcpy(end, parts[j].iov_base, parts[j].iov_len);
        memcpy(&one->address, to, to_size);
        one->fd = fd, one->passes = 1 + (int)draw(8), one->size = size, one->address_size = to_size;
        __atomic_add_fetch(&network->delayed, 1, __ATOMIC_RELAXED);
        return 1;
    }
    return 0;
}

ssize_t sendto(int fd, const void *data, size_t size, int flags, const struct sockaddr *to, socklen_t to_size) {
    if (is_datagram(fd, to)) {
        struct iovec part = {(void *)data, size};
        pthread_mutex_lock(&turn);
        int gone = taken(fd, &part, 1, to, to_size);
        pthread_mutex_unlock(&turn);
        if (gone) return (ssize_t)size;
    }
    return send_now(fd, data, size, flags, to, to_size);
}

ssize_t sendmsg(int fd, const struct msghdr *message, int flags) {
    if (is_datagram(fd, message->msg_name)) {
        size_t size = 0;
        for (size_t k = 0; k < message->msg_iovlen; k++) size += message->msg_iov[k].iov_len;
        pthread_mutex_lock(&turn);
        int gone = taken(fd, message->msg_iov, message->msg_iovlen, message->msg_name, message->msg_namelen);
        pthread_mutex_unlock(&turn);
        if (gone) return (ssize_t)size;
    }
    return send_message_now(fd, message, flags);
}

ssize_t recvfrom(int fd, void *data, size_t size, int flags, struct sockaddr *from, socklen_t *from_size) {
    ssize_t count;
    do {
        count = receive_now(fd, data, size, flags, from, from_size);
    } while (count >= 0 && __atomic_load_n(&network->loss, __ATOMIC_RELAXED) >= ALL && is_datagram(fd, from));
    return count;
}
