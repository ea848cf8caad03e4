// Signal K server plugin: hands on what `autopilot signalk` says, and is the provider of the server's autopilot API.
// One line of JSON each way: deltas come, PUT requests go, each answered. Node.js alone, no packages.
'use strict'

const { AsyncLocalStorage } = require('async_hooks')
const net = require('net')

const DEVICE = 'norrbin'
const LABEL = 'norrbin' // of what `autopilot signalk` says
const RETRY_MS = 2000
const OVERBOARD_MS = 10000 // how often a man overboard is said on board while it is so
const ANSWER_MS = 10000
const SILENT_MS = 5000 // the bridge says every second that it lives
const LONGEST = 1 << 20
const STATE = 'steering.autopilot.state'
const MODE = 'steering.autopilot.mode'
const ENGAGED = 'steering.autopilot.engaged'
const TARGET = 'steering.autopilot.target'
const TRUE_HEADING = TARGET + '.headingTrue'
const MAGNETIC_HEADING = TARGET + '.headingMagnetic'
const WIND_ANGLES = { wind: TARGET + '.windAngleApparent', 'true wind': TARGET + '.windAngleTrueWater' }
const ACTIONS = 'steering.autopilot.actions.'
const ADJUST = ACTIONS + 'adjustHeading'
const DODGE = ACTIONS + 'dodge'
const ACKNOWLEDGE = ACTIONS + 'acknowledge'
const TACK = ACTIONS + 'tack'
const GYBE = ACTIONS + 'gybe'
const ADVANCE = ACTIONS + 'advanceWaypoint'
const NOTIFICATIONS = 'notifications.steering.autopilot.norrbin.'
const MOB = 'notifications.mob'
const OFF_LINE = 'off-line'
const STATES = [
  { name: 'auto', engaged: true },
  { name: 'wind', engaged: true },
  { name: 'route', engaged: true },
  { name: 'trial', engaged: true },
  { name: 'standby', engaged: false },
  { name: OFF_LINE, engaged: false },
  // ordered by dashboards, whatever the state is called: steer in the mode chosen, or do not
  { name: 'enabled', engaged: true },
  { name: 'disabled', engaged: false }
]
const ORDERED = ['auto', 'wind', 'route', 'standby']
const MODES = ['compass', 'wind', 'true wind', 'route']
const COMPASS = MODES[0]

module.exports = function (app) {
  let socket = null
  let retry = null
  let stopped = true
  let options = {}
  let received = ''
  let beat = null // what the bridge has said last of its time: an order with an old one came late, and is not carried out
  let quiet = null
  let count = 0
  let hasDodged = false
  let wasEngaged = false
  let chosen = COMPASS // the mode that is engaged in; steering, it is the one that is
  let known = {}
  const waiting = new Map()
  const alarms = new Set()
  const overboard = new Map() // where somebody is, by the path of the notification that says so; null: not known
  const subscriptions = []
  let saying = null
  const requests = new AsyncLocalStorage()

  // ---- the line to `autopilot signalk`

  function connect() {
    received = ''
    beat = null
    socket = net.createConnection({ host: options.host || '127.0.0.1', port: options.port || 8376 })
    socket.setEncoding('utf8')
    socket.setKeepAlive(true, 5000)
    socket.on('connect', greet)
    socket.on('data', take)
    socket.on('error', (error) => app.setPluginError(`autopilot signalk: ${error.message}; trying again`))
    socket.on('close', gone)
  }

  // who has shown the token keeps its place while others come
  function greet() {
    app.setPluginStatus('connected to autopilot signalk')
    if (options.token) socket.write(JSON.stringify({ requestId: 'greeting', token: options.token }) + '\n')
  }

  function gone() {
    socket = null
    clearTimeout(quiet)
    for (const { reject, timer } of waiting.values()) {
      clearTimeout(timer)
      reject(failure(503, 'the line to autopilot signalk is down'))
    }
    waiting.clear()
    if (stopped) return
    offLine()
    app.setPluginError('autopilot signalk is not there; trying again')
    retry = setTimeout(connect, RETRY_MS)
  }

  function offLine() {
    known = {}
    tell({ [STATE]: OFF_LINE, [ENGAGED]: false, [MODE]: null, [TARGET]: null })
  }

  function take(text) {
    received += text
    const lines = received.split('\n')
    received = lines.pop()
    if (received.length > LONGEST) return socket.destroy()
    for (const line of lines) {
      let message
      try {
        message = Object(JSON.parse(line))
      } catch {
        return socket.destroy()
      }
      if (message.beat !== undefined) alive(message.beat)
      else if (message.requestId !== undefined) answered(message)
      else if (Array.isArray(message.updates)) heard(message)
    }
  }

  function alive(said) {
    beat = said
    clearTimeout(quiet)
    quiet = setTimeout(() => socket && socket.destroy(), SILENT_MS)
  }

  function heard(delta) {
    const values = {}
    for (const update of delta.updates) for (const { path, value } of update.values || []) values[path] = value
    tell(values)
  }

  function tell(values) {
    Object.assign(known, values)
    if (!state().engaged) hasDodged = false
    // a chosen mode waits in standby alone; after steering it is the compass again
    if (MODES.includes(known[MODE])) chosen = known[MODE]
    else if (state().engaged || wasEngaged) chosen = COMPASS
    wasEngaged = state().engaged
    const changes = Object.entries(values).filter(([path]) => !isOurs(path)).map(([path, value]) => ({ path, value }))
    for (const { path } of changes) if (path.startsWith(NOTIFICATIONS) || path === MOB) watch(path)
    // apart: the server gives all of an update that has a notification in it another source
    for (const apart of [false, true]) {
      const group = changes.filter(({ path }) => path.startsWith('notifications.') === apart)
      if (group.length) app.handleMessage(plugin.id, { context: 'vessels.self', updates: [{ values: group }] })
    }
    if ([STATE, MODE, TARGET].some((path) => path in values)) update()
  }

  function update() {
    const { name, engaged } = state()
    app.autopilotUpdate(DEVICE, { state: name, mode: chosen, target: target(), engaged, actions: actions() })
  }

  // ---- alarms: who silences one by a PUT of version 1 acknowledges on board. The server's notifications API (v2) is not
  // heeded: signalk-server 2.23 lets everybody acknowledge there, signed in or not.

  function watch(path) {
    if (alarms.has(path)) return
    alarms.add(path)
    app.registerPutHandler('vessels.self', `${path}.method`, handler((method) => silence(path, method)))
    app.registerPutHandler('vessels.self', `${path}.state`, handler(never('way to end an alarm but to end its cause')))
  }

  async function silence(path, method) {
    if (!Array.isArray(method) || method.includes('sound')) throw failure(400, 'method: a list without sound is allowed')
    await put(ACKNOWLEDGE, path)
  }

  // ---- a man overboard whom another program reports: said on board at once and again and again, and ended there alone

  function hearOverboard(delta) {
    for (const update of delta.updates || []) {
      for (const { path, value } of update.values || []) {
        if (path !== MOB && !path.startsWith(MOB + '.')) continue
        // what comes back of our own, by us or by a plain connection, is no report of another
        if (`${update.$source || ''}`.startsWith(plugin.id) || (update.source || {}).label === LABEL) continue
        if (!value || !['alarm', 'emergency'].includes(value.state)) overboard.delete(path)
        else if (!overboard.has(path) || placeIn(value)) {
          const isNew = !overboard.has(path)
          overboard.set(path, placeIn(value) || placeIn({ position: app.getSelfPath('navigation.position.value') }))
          if (isNew) sayOverboard()
        }
      }
    }
  }

  function placeIn(value) {
    const { latitude, longitude } = value.position || {}
    return Number.isFinite(latitude) && Number.isFinite(longitude) ? { latitude, longitude } : null
  }

  function sayOverboard() {
    const [place] = overboard.values()
    if (place !== undefined) put(MOB, place).catch((error) => app.setPluginError(`man overboard: ${error.message}`))
  }

  // what the autopilot API tells by itself
  function isOurs(path) {
    return [STATE, MODE, ENGAGED, TARGET].includes(path)
  }

  function answered(message) {
    const asked = waiting.get(message.requestId)
    if (!asked) return
    waiting.delete(message.requestId)
    clearTimeout(asked.timer)
    if (message.statusCode === 200) asked.resolve()
    else asked.reject(failure(message.statusCode, message.message || 'refused'))
  }

  function put(path, value) {
    if (!socket || beat === null) return Promise.reject(failure(503, 'autopilot signalk is not there'))
    const requestId = `${++count}`
    return new Promise((resolve, reject) => {
      const timer = setTimeout(() => {
        waiting.delete(requestId)
        reject(failure(504, 'the pilot does not answer'))
      }, ANSWER_MS)
      waiting.set(requestId, { resolve, reject, timer })
      socket.write(JSON.stringify({ requestId, token: options.token || '', beat, put: { path, value } }) + '\n')
    })
  }

  function failure(statusCode, message) {
    return Object.assign(new Error(message), { statusCode, state: 'FAILED' })
  }

  // ---- what is known

  function state() {
    const name = known[STATE] || OFF_LINE
    return STATES.find((each) => each.name === name) || { name, engaged: false }
  }

  function target() {
    const value = known[TARGET]
    return typeof value === 'number' ? value : null
  }

  function actions() {
    const { name, engaged } = state()
    return [
      { id: 'dodge', name: 'Dodge', available: engaged && name !== 'trial' },
      { id: 'tack', name: 'Tack', available: name === 'wind' },
      { id: 'gybe', name: 'Gybe', available: name === 'wind' },
      { id: 'courseCurrentPoint', name: 'Follow the route', available: name !== OFF_LINE },
      { id: 'courseNextPoint', name: 'Next waypoint', available: name === 'route' }
    ]
  }

  const degrees = (radians) => (radians * 180) / Math.PI
  const never = (what) => async () => {
    throw failure(400, `this pilot knows no ${what}`)
  }

  function present() {
    if (!socket || beat === null) throw failure(503, 'autopilot signalk is not there')
    if (state().name === OFF_LINE) throw failure(503, 'no pilot is heard')
  }

  function steering(what) {
    present()
    if (!state().engaged) throw failure(409, `${what}: nothing is steered, engage first`)
  }

  // signalk-server (2.23 to 2.32) asks who puts and posts, but not who deletes: so we look at whose request it is
  const note = (request) => requests.enterWith(request)

  function asked() {
    const request = requests.getStore()
    return Boolean(request) && app.securityStrategy.shouldAllowPut(request, 'vessels.self', null, 'autopilot')
  }

  // ---- the autopilot API, version 2

  const provider = {
    getData: async () => ({
      options: { states: STATES, modes: MODES, actions: actions() },
      target: target(),
      mode: chosen,
      state: state().name,
      engaged: state().engaged
    }),
    getState: async () => state().name,
    setState: async (value) => {
      if (value === 'enabled') return provider.engage()
      if (value === 'disabled') return provider.disengage()
      if (!ORDERED.includes(value)) throw failure(400, `state: ${ORDERED.join(', ')}, enabled, disabled are allowed`)
      await put(STATE, value)
    },
    getMode: async () => chosen,
    setMode: async (value) => {
      if (!MODES.includes(value)) throw failure(400, `mode: ${MODES.join(', ')} are allowed`)
      present()
      if (state().engaged) return put(MODE, value)
      chosen = value
      update()
    },
    getTarget: async () => target(),
    setTarget: async (value) => {
      steering('target')
      if (state().name !== 'wind') return put(MAGNETIC_HEADING in known ? MAGNETIC_HEADING : TRUE_HEADING, value)
      await put(WIND_ANGLES[chosen], value)
    },
    adjustTarget: async (value) => {
      steering('target')
      await put(ADJUST, degrees(value))
    },
    engage: async () => {
      if (!state().engaged) await put(MODE, chosen)
    },
    disengage: () => put(STATE, 'standby'),
    courseCurrentPoint: () => put(STATE, 'route'),
    courseNextPoint: () => put(ADVANCE, '1'),
    tack: (direction) => put(TACK, direction),
    gybe: (direction) => put(GYBE, direction),
    dodge: async (value) => {
      if (value === null) {
        if (!asked()) throw failure(403, 'dodge: who ends it is not known to the server; sign in')
        if (hasDodged) await put(DODGE, null)
        hasDodged = false
      } else {
        steering('dodge')
        if (value === 0) return
        await put(DODGE, degrees(value))
        hasDodged = true
      }
    }
  }

  // ---- PUT requests of version 1, as KIP and older programs send them

  function handler(order) {
    return (_context, _path, value, done) => {
      order(value).then(
        () => done({ state: 'COMPLETED', statusCode: 200 }),
        (error) => done({ state: 'COMPLETED', statusCode: error.statusCode || 500, message: error.message })
      )
      return { state: 'PENDING' }
    }
  }

  async function turnToMagnetic(value) {
    if (MAGNETIC_HEADING in known) return put(MAGNETIC_HEADING, value)
    const variation = app.getSelfPath('navigation.magneticVariation.value')
    if (typeof value !== 'number' || typeof variation !== 'number') {
      throw failure(400, 'a magnetic heading needs navigation.magneticVariation; give headingTrue instead')
    }
    await put(TRUE_HEADING, (value + variation) % (2 * Math.PI))
  }

  const plugin = {
    id: 'signalk-norrbin',
    name: 'Norrbin autopilot',
    description: 'State of a Norrbin autopilot as deltas, and orders from Signal K programs to it',
    schema: {
      type: 'object',
      properties: {
        host: { type: 'string', title: 'Address of autopilot signalk', default: '127.0.0.1' },
        port: { type: 'number', title: 'Port of autopilot signalk', default: 8376 },
        token: { type: 'string', title: 'Token, as in the file that autopilot signalk was given (empty: look only)', default: '' }
      }
    },
    start: (configuration) => {
      options = configuration || {}
      stopped = false
      if (app.server) app.server.prependListener('request', note)
      app.registerAutopilotProvider(provider, [DEVICE])
      app.registerPutHandler('vessels.self', STATE, handler((value) => provider.setState(value)))
      app.registerPutHandler('vessels.self', MAGNETIC_HEADING, handler(turnToMagnetic))
      for (const path of [TRUE_HEADING, ...Object.values(WIND_ANGLES), ADJUST, TACK, GYBE, ADVANCE, ACKNOWLEDGE]) {
        app.registerPutHandler('vessels.self', path, handler((value) => put(path, value)))
      }
      const paths = [MOB, MOB + '.*'].map((path) => ({ path, policy: 'instant' }))
      app.subscriptionmanager.subscribe(
        { context: 'vessels.self', subscribe: paths }, subscriptions, (error) => app.setPluginError(`${error}`), hearOverboard
      )
      saying = setInterval(sayOverboard, OVERBOARD_MS)
      connect()
    },
    stop: () => {
      stopped = true
      clearInterval(saying)
      for (const end of subscriptions.splice(0)) end()
      overboard.clear()
      if (app.server) app.server.removeListener('request', note)
      clearTimeout(retry)
      offLine() // or the state that was would stand there for good
      if (socket) socket.destroy()
    }
  }
  return plugin
}
